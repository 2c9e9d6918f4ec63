// Stiffness of a surface by rollouts: sysid/identification/rollout_fit.hpp.
#include <algorithm>
#include <cmath>
#include <tuple>

#include <Eigen/Dense>

#include "backends/mujoco/plant.hpp"
#include "sysid/identification/actuation.hpp"
#include "sysid/identification/rollout_fit.hpp"
#include "sysid/identification/rollouts.hpp"

namespace multipanda {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

constexpr std::size_t kSurfaceBlocks = 4, kSurfaceCandidates = 5;
constexpr double kLeastForce = 2.0;      // smallest force that counts as contact [N]
constexpr double kLeastChange = 0.5;     // smallest useful standard deviation of the force [N]
constexpr double kDistanceNoise = 1e-5;  // unit of the residual [m]
constexpr double kFar = 0.2;             // distances beyond are not computed [m]
constexpr Index kMean = 25;              // half width of moving means [samples]

[[noreturn]] void refuse(const std::string& what) { throw std::invalid_argument(what); }

struct Distance {
  double value = 0;                    // below 0: inside [m]
  Vector3 outwards = Vector3::Zero();  // normal of the surface, towards the tool
  Vector3 point = Vector3::Zero();     // nearest on the tool, world
};

// The tool shape and the object whose distance is computed.
struct Places {
  int tool = -1, surface = -1, body = -1, pair = -1;
  Distance distance(const RolloutMember& member) const {
    double from_to[6] = {};
    const double value = mj_geomDistance(member.model, member.data, tool, surface, kFar, from_to);
    const Eigen::Map<const Vector3> from(from_to), to(from_to + 3);
    Distance d{.value = value, .outwards = Vector3::Zero(), .point = from};
    if (std::abs(value) > 1e-9) d.outwards = (from - to) / value;
    return d;
  }
};

VectorXd moving_mean(const VectorXd& x) {
  VectorXd mean(x.size());
  for (Index k = 0; k < x.size(); ++k) {
    const Index a = std::max<Index>(0, k - kMean), b = std::min<Index>(x.size() - 1, k + kMean);
    mean[k] = x.segment(a, b - a + 1).mean();
  }
  return mean;
}

class Pressing {
 public:
  Pressing(const MeasuredLog& log, const Scene& scene, std::size_t arm, const std::string& object,
           const RolloutOptions& options)
      : log_(log), rollouts_(scene, arm, kSurfaceBlocks * kSurfaceCandidates, options.threads) {
    const SceneArm& scene_arm = scene.arms.at(arm);
    nominal_ = find_object(scene, object).contact->stiffness_n_per_m;
    if (scene_arm.tool_shapes.empty()) refuse("arm '" + scene_arm.name + "' has no tool shapes");
    std::vector<Places> tools;
    for (std::size_t i = 0; i < scene_arm.tool_shapes.size(); ++i)
      tools.push_back(places(scene_arm.name, i, object));
    measure(tools);
    rough_start(options);
  }

  double rough_stiffness() const { return rough_stiffness_; }
  double rough_height() const { return rough_height_; }
  const std::vector<RolloutWindow>& windows() const { return windows_; }
  Index rows_of_window() const { return windows_[0].length; }
  std::size_t rollouts() const { return simulated_; }
  const std::string& error() const { return rollouts_.error(); }

  // Candidates of (log stiffness, height).
  std::vector<VectorXd> operator()(const MatrixXd& candidates) {
    const auto count = static_cast<std::size_t>(candidates.cols());
    std::vector<VectorXd> e(count, VectorXd(rows_of_window() * static_cast<Index>(windows_.size())));
    const bool whole = rollouts_.run(count * kSurfaceBlocks, [&](RolloutMember& member, std::size_t i) {
      const std::size_t c = i / kSurfaceBlocks;
      const double height = candidates(1, static_cast<Index>(c));
      set_surface(member, std::exp(candidates(0, static_cast<Index>(c))), height);
      for (std::size_t w = i % kSurfaceBlocks; w < windows_.size(); w += kSurfaceBlocks) {
        replay(member, windows_[w], height,
               e[c].segment(static_cast<Index>(w) * rows_of_window(), rows_of_window()));
      }
    });
    simulated_ += count * windows_.size();
    for (auto& column : e) {
      if (!whole || !column.allFinite()) column.resize(0);
    }
    return e;
  }

 private:
  static const SceneObject& find_object(const Scene& scene, const std::string& name) {
    for (const auto& object : scene.objects) {
      if (object.name != name) continue;
      if (!object.fixed) refuse("object '" + name + "' is free: only a fixed surface can be fitted");
      if (!object.contact)
        refuse("object '" + name +
               "' has no `contact` in its scene; add one as the initial guess of the fit");
      return object;
    }
    refuse("no object '" + name + "' in the scene of the log");
  }

  Places places(const std::string& arm, std::size_t shape, const std::string& object) {
    const mjModel* m = rollouts_.member(0).model;
    const std::string tool = arm + "/" + tool_shape_name(shape);
    Places p{.tool = mj_name2id(m, mjOBJ_GEOM, tool.c_str()),
             .surface = mj_name2id(m, mjOBJ_GEOM, object.c_str()),
             .body = mj_name2id(m, mjOBJ_BODY, object.c_str())};
    for (int i = 0; i < m->npair; ++i) {
      if (m->pair_geom1[i] == p.tool && m->pair_geom2[i] == p.surface) p.pair = i;
      if (m->pair_geom2[i] == p.tool && m->pair_geom1[i] == p.surface) p.pair = i;
    }
    if (p.tool < 0 || p.surface < 0 || p.body < 0 || p.pair < 0)
      refuse("'" + tool + "' cannot touch '" + object + "'");
    for (int i = 0; i < 3; ++i) place_[i] = m->body_pos[3 * p.body + i];
    for (int i = 0; i < 2; ++i) solref_[i] = m->pair_solref[mjNREF * p.pair + i];
    return p;
  }

  // Along the log: the tool's distance from the surface in the scene, and the force on it from the arm's own
  // model, tau_J = M ddq + c + g - J^T F without M ddq.
  void measure(const std::vector<Places>& tools) {
    const Index rows = log_.samples();
    distance_.resize(rows);
    VectorXd force = VectorXd::Zero(rows);
    MatrixXd outwards(rows, 3);
    rollouts_.run(1, [&](RolloutMember& member, std::size_t) {
      double nearest = kFar;
      places_ = tools[0];
      Eigen::Matrix<double, 3, Eigen::Dynamic> J(3, log_.joints());
      for (int pass = 0; pass < 2; ++pass) {  // first pass: which of the tool's shapes
        for (Index k = 0; k < rows; k += pass == 0 ? 50 : 1) {
          rollouts_.begin(member, log_.q.row(k), log_.dq.row(k));
          mj_kinematics(member.model, member.data);
          if (pass == 0) {
            for (const Places& tool : tools) {
              const double here = tool.distance(member).value;
              if (here < nearest) std::tie(nearest, places_) = std::tuple(here, tool);
            }
            continue;
          }
          const Distance d = places_.distance(member);
          distance_[k] = d.value;
          outwards.row(k) = d.outwards;
          member.terms->update(member.q, member.dq);
          member.terms->point_jacobian(static_cast<std::size_t>(log_.joints() - 1), d.point, J);
          const VectorXd along = J.transpose() * d.outwards;
          if (along.squaredNorm() < 1e-9) continue;
          const VectorXd external = log_.tau.row(k).transpose() - member.terms->c() - member.terms->g();
          force[k] = -along.dot(external) / along.squaredNorm();
        }
      }
    });
    if (!rollouts_.error().empty()) refuse("the log does not match its scene: " + rollouts_.error());
    force_ = moving_mean(force);
    Vector3 sum = Vector3::Zero();
    for (Index k = 0; k < rows; ++k) {
      if (force_[k] > kLeastForce && distance_[k] < 0.5 * kFar) sum += outwards.row(k).transpose();
    }
    if (sum.norm() > 0) outwards_ = sum.normalized();
  }

  // Slope of force against depth over rows in contact.
  void rough_start(const RolloutOptions& options) {
    const VectorXd depth = -moving_mean(distance_);
    std::vector<std::vector<char>> touches(1, std::vector<char>(static_cast<std::size_t>(log_.samples()), 0));
    double n = 0, x = 0, y = 0, xx = 0, xy = 0, yy = 0;
    for (Index k = 0; k < log_.samples(); ++k) {
      if (!(force_[k] > kLeastForce) || !(distance_[k] < 0.5 * kFar)) continue;
      touches[0][static_cast<std::size_t>(k)] = 1;
      n += 1;
      x += depth[k];
      y += force_[k];
      xx += depth[k] * depth[k];
      xy += depth[k] * force_[k];
      yy += force_[k] * force_[k];
    }
    windows_ = choose_windows(std::span(&log_, 1), options.window, options.windows, touches);
    if (windows_.size() < 4) {
      throw LogRefused(log_.source + ": the tool presses on the surface in " +
                       std::to_string(windows_.size()) +
                       " windows of the log, expected at least 4; record a run in contact, above " +
                       std::to_string(kLeastForce) + " N");
    }
    const double change = std::sqrt(std::max(0.0, yy / n - (y / n) * (y / n)));
    if (change < kLeastChange) {
      throw LogRefused(log_.source + ": the force on the surface changes by " + std::to_string(change) +
                       " N (standard deviation); below " + std::to_string(kLeastChange) +
                       " N the stiffness is not identifiable; vary the force");
    }
    const double slope = (xy - x * y / n) / std::max(xx - x * x / n, 1e-18);
    rough_stiffness_ = std::clamp(slope, 200.0, 1e6);
    rough_height_ = -(x / n) + (y / n) / rough_stiffness_;
  }

  // The damping ratio stays the same.
  void set_surface(RolloutMember& member, double stiffness, double height) const {
    const double times = stiffness / nominal_;
    mjtNum* solref = member.model->pair_solref + mjNREF * places_.pair;
    solref[0] = solref_[0] * times;
    solref[1] = solref_[1] * std::sqrt(times);
    for (int i = 0; i < 3; ++i) {
      member.model->body_pos[3 * places_.body + i] = place_[i] + height * outwards_[i];
    }
  }

  void replay(RolloutMember& member, const RolloutWindow& window, double height,
              Eigen::Ref<VectorXd> e) const {
    rollouts_.begin(member, window.q, window.dq);
    rollouts_.lead_in(member, log_.dq, window.first);
    JointVector torque = window.q;
    for (Index k = 0; k < window.length; ++k) {
      torque = log_.tau.row(window.first + k + 1).transpose();
      rollouts_.period(member, torque, nullptr);
      mj_kinematics(member.model, member.data);
      const double predicted = places_.distance(member).value + height;
      e[k] = (predicted - distance_[window.first + k + 1]) / kDistanceNoise;
    }
  }

  const MeasuredLog& log_;
  Rollouts rollouts_;
  Places places_;
  double nominal_ = 0, place_[3] = {}, solref_[2] = {};
  Vector3 outwards_ = Vector3::UnitZ();
  VectorXd distance_, force_;
  double rough_stiffness_ = 0, rough_height_ = 0;
  std::vector<RolloutWindow> windows_;
  std::size_t simulated_ = 0;
};

}  // namespace

SurfaceFit fit_surface(const MeasuredLog& log, const Scene& scene, std::size_t arm, const std::string& object,
                       const RolloutOptions& options) {
  Pressing pressing(log, scene, arm, object, options);
  BatchLeastSquares problem;
  problem.start = Eigen::Vector2d(std::log(pressing.rough_stiffness()), pressing.rough_height());
  problem.step = Eigen::Vector2d(0.02, 2e-6);
  problem.lower = Eigen::Vector2d(std::log(50.0), pressing.rough_height() - 0.02);
  problem.upper = Eigen::Vector2d(std::log(5e6), pressing.rough_height() + 0.02);
  problem.cluster = pressing.rows_of_window();
  problem.passes = options.passes;
  SurfaceFit result;
  result.rough_stiffness = pressing.rough_stiffness();
  result.fit.names = {"stiffness [N/m]", "height [mm]"};
  const auto shown = [&](int pass, double rms, const VectorXd& x) {
    const Eigen::Vector2d value(std::exp(x[0]), 1e3 * x[1]);
    return !options.progress || options.progress({pass, rms, result.fit.names, value, pressing.rollouts()});
  };
  BatchLeastSquaresResult solved;
  try {
    solved = solve(
        problem, [&](const MatrixXd& c) { return pressing(c); }, shown);
  } catch (const std::runtime_error& error) {
    throw LogRefused(log.source + ": " + error.what() + " " + pressing.error());
  }
  const VectorXd half = 1.96 * solved.covariance.diagonal().cwiseSqrt();
  result.stiffness = std::exp(solved.x[0]);
  result.stiffness_half95 = result.stiffness * half[0];
  result.height = solved.x[1];
  result.height_half95 = half[1];
  result.fit.value = Eigen::Vector2d(result.stiffness, 1e3 * result.height);
  result.fit.half95 = Eigen::Vector2d(result.stiffness_half95, 1e3 * result.height_half95);
  result.fit.rms = solved.rms;
  result.fit.passes = solved.passes;
  result.fit.converged = solved.converged;
  result.fit.windows = pressing.windows().size();
  result.fit.rollouts = pressing.rollouts();
  if (!solved.converged) {
    result.fit.warnings.push_back("not converged after " + std::to_string(solved.passes) + " passes");
  }
  return result;
}

}  // namespace multipanda

#include "fci/client/model_check.hpp"

#include <algorithm>
#include <cstdio>
#include <dlfcn.h>
#include <fstream>
#include <functional>
#include <memory>
#include <random>
#include <stdexcept>
#include <sys/mman.h>
#include <unistd.h>

#include "core/model/model_terms.hpp"

namespace multipanda::fci {
namespace {

// Manufacturers and versions prefix link names: "link8", "fr3_link8".
std::string flange_link(const std::string& urdf) {
  for (std::size_t at = urdf.find("<link"); at != std::string::npos; at = urdf.find("<link", at + 1)) {
    const std::size_t name = urdf.find("name=", at), end = urdf.find('>', at);
    if (name == std::string::npos || name > end || name + 6 >= urdf.size()) continue;
    const char quote = urdf[name + 5];
    const std::size_t last = urdf.find(quote, name + 6);
    if (last == std::string::npos) continue;
    const std::string link = urdf.substr(name + 6, last - name - 6);
    if (link.ends_with("link8")) return link;
  }
  throw std::invalid_argument("the arm's model has no link8 (the flange)");
}

// Poses, masses and gravity of the arm, with the load behind its flange, in the frames of the scene's model.
struct Outputs {
  Pose X_WF;
  Eigen::MatrixXd M;
  Eigen::VectorXd g;
};

void compare(const ArmModel& ours, const JointVector& low, const JointVector& high,
             const std::function<Outputs(const JointVector&)>& theirs, ModelComparison& result) {
  ModelTerms a(std::shared_ptr<const ArmModel>(&ours, [](const ArmModel*) {}));
  std::mt19937_64 random(20260101);
  std::uniform_real_distribution<double> part(0.02, 0.98);
  JointVector q = low;
  const JointVector still = joint_constant(ours.joint_count(), 0);
  for (int k = 0; k < 200; ++k) {
    for (Eigen::Index i = 0; i < q.size(); ++i) q[i] = low[i] + part(random) * (high[i] - low[i]);
    a.update(q, still);
    const Outputs b = theirs(q);
    const Vector6 apart = pose_error(a.X_WF(), b.X_WF);
    result.position_m = std::max(result.position_m, apart.head<3>().norm());
    result.orientation_rad = std::max(result.orientation_rad, apart.tail<3>().norm());
    result.gravity_nm = std::max(result.gravity_nm, (a.g() - b.g).lpNorm<Eigen::Infinity>());
    result.mass_matrix = std::max(result.mass_matrix, (a.M() - b.M).norm() / b.M.norm());
  }
}

// A shared library that is loaded from memory; its three functions that are used here.
class Library {
 public:
  explicit Library(const std::vector<std::byte>& bytes) {
    const int file = ::memfd_create("model", MFD_CLOEXEC);
    const std::string path = "/proc/self/fd/" + std::to_string(file);
    std::ofstream(path, std::ios::binary)
        .write(reinterpret_cast<const char*>(bytes.data()), static_cast<std::streamsize>(bytes.size()));
    handle_ = ::dlopen(path.c_str(), RTLD_NOW | RTLD_LOCAL);
    const char* const why = handle_ == nullptr ? ::dlerror() : "";
    if (file >= 0) ::close(file);
    if (handle_ == nullptr)
      throw std::invalid_argument(std::string("the arm's library cannot be loaded: ") + why);
    find("O_T_J8", pose);
    find("M_NE", mass);
    find("g_NE", gravity);
  }
  Library(const Library&) = delete;
  Library& operator=(const Library&) = delete;
  ~Library() { ::dlclose(handle_); }

  // Matrices are column-major.
  void (*pose)(const double* q, double* O_T_F) = nullptr;
  void (*mass)(const double* q, const double* I_load, double m_load, const double* F_x_Cload,
               double* M) = nullptr;
  void (*gravity)(const double* q, const double* g_earth, double m_load, const double* F_x_Cload,
                  double* g) = nullptr;

 private:
  template <typename Function>
  void find(const char* name, Function& function) {
    void* const symbol = ::dlsym(handle_, name);
    if (symbol == nullptr) {
      ::dlclose(handle_);
      throw std::invalid_argument(std::string("the arm's library has no function ") + name);
    }
    function = reinterpret_cast<Function>(symbol);
  }

  void* handle_ = nullptr;
};

}  // namespace

std::string ModelComparison::text() const {
  std::array<char, 400> text{};
  std::snprintf(text.data(), text.size(),
                "flange %.2g m and %.2g rad apart; gravity torque %.3f N m, mass matrix %.2f %% different",
                position_m, orientation_rad, gravity_nm, 100 * mass_matrix);
  return limits.empty() ? text.data() : std::string(text.data()) + "; " + limits;
}

ModelComparison compare_models(const std::string& arm_urdf, const Load& hand, const ArmModel& ours) {
  ArmModelSource source;
  source.name = "model from the arm";
  source.urdf = arm_urdf;
  source.flange = flange_link(arm_urdf);
  source.X_WB = ours.X_WB();
  const auto theirs = std::make_shared<const ArmModel>(std::move(source));
  if (theirs->joint_count() != ours.joint_count()) {
    throw std::invalid_argument("the arm's model has " + std::to_string(theirs->joint_count()) +
                                " joints, the scene's model has " + std::to_string(ours.joint_count()));
  }
  ModelTerms b(theirs);
  b.set_config({}, hand, {});

  ModelComparison result;
  const auto n = static_cast<Eigen::Index>(ours.joint_count());
  const JointVector still = joint_constant(ours.joint_count(), 0);
  compare(
      ours, ours.limits().q_min.cwiseMax(theirs->limits().q_min),
      ours.limits().q_max.cwiseMin(theirs->limits().q_max),
      [&](const JointVector& q) {
        b.update(q, still);
        return Outputs{b.X_WF(), b.M(), b.g()};
      },
      result);
  for (Eigen::Index i = 0; i < n; ++i) {
    const double below = theirs->limits().q_min[i] - ours.limits().q_min[i],
                 above = ours.limits().q_max[i] - theirs->limits().q_max[i];
    constexpr double kSame = 1e-6;
    if (below <= kSame && above <= kSame) continue;
    result.q_min_rad = std::max(result.q_min_rad, below);
    result.q_max_rad = std::max(result.q_max_rad, above);
    std::array<char, 160> text{};
    std::snprintf(text.data(), text.size(),
                  "%sjoint%d: the arm allows %.4f to %.4f rad, the scene's model %.4f to %.4f",
                  result.limits.empty() ? "" : ", ", static_cast<int>(i) + 1, theirs->limits().q_min[i],
                  theirs->limits().q_max[i], ours.limits().q_min[i], ours.limits().q_max[i]);
    result.limits += text.data();
  }
  return result;
}

ModelComparison compare_models(const std::vector<std::byte>& arm_library, const Load& hand,
                               const ArmModel& ours) {
  if (ours.joint_count() != 7) {
    throw std::invalid_argument("the arm's library has 7 joints, the scene's model has " +
                                std::to_string(ours.joint_count()));
  }
  const Library library(arm_library);
  const Vector3 down_B = ours.X_WB().rotation.transpose() * Vector3(0, 0, -9.81);
  ModelComparison result{.gravity_limit_nm = 0.3, .mass_limit = 0.08};
  compare(
      ours, ours.limits().q_min, ours.limits().q_max,
      [&](const JointVector& q) {
        Eigen::Matrix4d T;
        Outputs found{{}, Eigen::MatrixXd(7, 7), Eigen::VectorXd(7)};
        library.pose(q.data(), T.data());
        library.mass(q.data(), hand.inertia_C.data(), hand.mass, hand.p_FC.data(), found.M.data());
        library.gravity(q.data(), down_B.data(), hand.mass, hand.p_FC.data(), found.g.data());
        found.X_WF = ours.X_WB() * Pose{T.topLeftCorner<3, 3>(), T.topRightCorner<3, 1>()};
        return found;
      },
      result);
  return result;
}

}  // namespace multipanda::fci

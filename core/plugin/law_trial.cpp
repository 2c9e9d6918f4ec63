#include "core/plugin/law_trial.hpp"

#include <algorithm>
#include <cmath>
#include <ctime>
#include <limits>
#include <random>

#include "core/controllets/goal_parameters.hpp"
#include "core/types/statistics.hpp"

namespace multipanda {
namespace {

constexpr std::size_t kStatesPerStart = 100;
constexpr double kDt = 0.001;  // [s]

double thread_time_us() {
  timespec now{};
  clock_gettime(CLOCK_THREAD_CPUTIME_ID, &now);
  return 1e6 * static_cast<double>(now.tv_sec) + 1e-3 * static_cast<double>(now.tv_nsec);
}

class Trial {
 public:
  Trial(const ControlletType& type, ArmModels models, std::uint32_t seed)
      : engine_(seed),
        law_(type.create(models)),
        parameters_(type.descriptor.parameters, models[0]->joint_count()),
        states_(models.size()),
        tau_(models.size()) {
    for (const auto& input : type.descriptor.inputs)
      inputs_.emplace_back(input, models[input.arm]->joint_count());
    std::size_t outputs = 0;
    for (const auto& output : type.descriptor.outputs) outputs += output.size;
    outputs_.assign(outputs, 0);
    for (std::size_t i = 0; i < models.size(); ++i) {
      terms_.emplace_back(models[i]);
      arms_.push_back({&states_[i], nullptr, &tau_[i]});
    }
    for (std::size_t i = 0; i < models.size(); ++i) arms_[i].terms = &terms_[i];
    law_->bound_parameters(parameters_);
  }

  // A running law keeps its stiffnesses: one that rises moves the set-point that its spring sees.
  void draw_state(bool starts) {
    for (std::size_t i = 0; i < states_.size(); ++i) {
      const ArmLimits& limits = terms_[i].model().limits();
      ArmState& state = states_[i];
      state.q = between(limits.q_min, limits.q_max);
      state.dq = between(-limits.dq_max, limits.dq_max);
      state.tau_ext_hat = between(-0.1 * limits.tau_max, 0.1 * limits.tau_max);
      state.has_wrench_estimate = true;
      for (auto& value : state.F_K_W_est.vector) value = uniform(-20, 20);
      terms_[i].update(state);
      state.tau_J = terms_[i].g() + between(-0.1 * limits.tau_max, 0.1 * limits.tau_max);
    }
    for (std::size_t i = 0; i < parameters_.size(); ++i) {
      if (!starts && is_stiffness(parameters_.spec(i))) continue;
      std::vector<double> values(parameters_.value_size(i));
      for (std::size_t k = 0; k < values.size(); ++k) {
        values[k] = uniform(parameters_.spec(i).min, parameters_.max(i, k));
        if (!parameters_.spec(i).choices.empty()) values[k] = std::round(values[k]);
      }
      parameters_.set_now(i, values);
    }
  }

  void draw_set_points() {
    for (auto& input : inputs_) {
      const ModelTerms& terms = terms_[input.spec().arm];
      Target target;
      target.id = ++target_;
      target.size = static_cast<std::uint8_t>(input.size());
      switch (input.spec().quantity) {
        case Quantity::pose: {
          const Pose X = terms_[input.spec().arm].X_WE();
          input.start(moved(X));
          target = pose_target(moved(X));
          target.id = target_;
          break;
        }
        case Quantity::joints: {
          const ArmLimits& limits = terms.model().limits();
          input.start(between(limits.q_min, limits.q_max));
          const JointVector q = between(limits.q_min, limits.q_max);
          std::copy(q.begin(), q.end(), target.values.begin());
          break;
        }
        default:
          input.start_constant(uniform(-10, 10));
          for (std::size_t k = 0; k < input.size(); ++k) target.values[k] = uniform(-10, 10);
      }
      input.set(target);
      const int steps = static_cast<int>(uniform(1, 20));
      for (int k = 0; k < steps; ++k) input.advance(5 * kDt, time_s_);
    }
  }

  LawResult start() {
    ControlContext now = context();
    law_->start_references(now);
    return guarded([&] { return law_->start(now); });
  }

  LawResult update() {
    for (std::size_t i = 0; i < tau_.size(); ++i)
      tau_[i].setZero(static_cast<Eigen::Index>(terms_[i].joint_count()));
    ControlContext now = context();
    const LawResult result = guarded([&] { return law_->update(now); });
    const bool finite = std::ranges::all_of(tau_, [](const JointVector& tau) { return tau.allFinite(); }) &&
                        std::ranges::all_of(outputs_, [](double value) { return std::isfinite(value); });
    return finite ? result : LawResult::fault;
  }

  // The model terms are computed again, as at the beginning of a cycle.
  void forget_terms() {
    for (std::size_t i = 0; i < states_.size(); ++i) terms_[i].update(states_[i]);
  }

  ControlContext context() {
    return {.dt = kDt,
            .time_s = time_s_,
            .arms = arms_,
            .inputs = inputs_,
            .parameters = &parameters_,
            .outputs = outputs_,
            .scene_arms = arms_};
  }
  void pass() { time_s_ += kDt; }

 private:
  double uniform(double a, double b) { return std::uniform_real_distribution<double>(a, b)(engine_); }
  JointVector between(const JointVector& a, const JointVector& b) {
    JointVector values = a;
    for (Eigen::Index i = 0; i < a.size(); ++i) values[i] = uniform(a[i], b[i]);
    return values;
  }
  Vector3 vector3(double size) {
    Vector3 v;
    for (auto& value : v) value = uniform(-size, size);
    return v;
  }
  Pose moved(const Pose& X) { return {exp_rotation(vector3(0.3)) * X.rotation, X.position + vector3(0.3)}; }

  template <typename Call>
  static LawResult guarded(Call call) {
    try {
      return call();
    } catch (...) {
      return LawResult::fault;
    }
  }

  std::mt19937 engine_;
  std::unique_ptr<Controllet> law_;
  ParameterSet parameters_;
  std::vector<Reference> inputs_;
  std::vector<double> outputs_;
  std::vector<ArmState> states_;
  std::vector<ModelTerms> terms_;
  std::vector<JointVector> tau_;
  std::vector<OwnedArm> arms_;
  std::uint64_t target_ = 0;
  double time_s_ = 0;
};

}  // namespace

LawTrial try_law(const ControlletType& type, ArmModels models, const LawTrialOptions& options,
                 const std::function<void(const LawTrialState&)>& each) {
  Trial trial(type, models, options.seed);
  LawTrial found;
  std::vector<double> times;
  bool running = false;
  std::size_t slow = 0;
  for (std::size_t number = 0; number < options.states && slow <= options.states / 1000; ++number) {
    const bool starts = !running || number % kStatesPerStart == 0;
    trial.draw_state(starts);
    LawResult result = starts ? trial.start() : LawResult::ok;
    running = result == LawResult::ok;
    if (!running && each) each({number, starts, trial.context(), result});
    trial.draw_set_points();
    if (running) {
      double shortest = std::numeric_limits<double>::infinity();
      for (int repeat = 0; repeat < options.repeats && result == LawResult::ok; ++repeat) {
        trial.forget_terms();
        const double begin = thread_time_us();
        result = trial.update();
        shortest = std::min(shortest, thread_time_us() - begin);
        if (repeat == 0 && each) each({number, starts, trial.context(), result});
      }
      times.push_back(shortest);
      if (shortest > options.most_us) ++slow;
      running = result == LawResult::ok;
    }
    if (result != LawResult::ok && found.faults++ == 0) found.first_fault = number;
    trial.pass();
    ++found.states;
  }
  if (times.empty()) return found;
  found.median_us = quantile(times, 0.5);
  found.p999_us = quantile(times, 0.999);
  found.worst_us = quantile(times, 1);
  return found;
}

}  // namespace multipanda

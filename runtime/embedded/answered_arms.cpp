// Real arms answered by a thread each (AnsweredArm), as arms of a hardware component.
#include <algorithm>
#include <mutex>
#include <stdexcept>

#include "fci/client/fci_backend.hpp"
#include "runtime/embedded/answered_arm.hpp"

namespace multipanda {
namespace {

using Arms = std::vector<std::unique_ptr<AnsweredArm>>;

// Requests of all arms; states come from the arms' reports.
class AnsweredBackend final : public Backend {
 public:
  explicit AnsweredBackend(const Arms& arms) : arms_(arms) {}

  std::size_t arm_count() const override { return arms_.size(); }
  Capabilities capabilities(ArmIndex arm) const override { return arms_[arm]->backend().capabilities(0); }
  ArmSet wait() override { return {}; }
  bool ended() const override { return false; }
  LoopTime now() const override { return {host_now().ns - begun_.ns}; }
  void read(ArmSet due, std::span<ArmState> states) override {
    for (ArmIndex i = 0; i < arms_.size(); ++i) {
      const ArmState& state = arms_[i]->report().state;
      if (due.contains(i)) states[i] = state;
      if (state.mode == ArmMode::disconnected) states[i].mode = ArmMode::disconnected;
    }
  }
  void write(ArmSet, std::span<const ArmCommand>) override {}
  std::uint64_t overruns() const override {
    std::uint64_t lost = 0;
    for (const auto& arm : arms_) lost += arm->backend().overruns();
    return lost;
  }
  std::optional<ConnectionStatistics> connection(ArmIndex arm) const override {
    return arms_[arm]->backend().connection(0);
  }
  using Backend::request;
  std::future<RequestAnswer> request(ArmIndex arm, ArmRequest request) override {
    if (arm >= arms_.size()) return refuse_request(no_such_arm(arm, arms_.size()));
    return arms_[arm]->backend().request(0, std::move(request));
  }
  std::future<RequestAnswer> request(ArmIndex arm, GripperRequest request) override {
    if (arm >= arms_.size()) return refuse_request(no_such_arm(arm, arms_.size()));
    return arms_[arm]->backend().request(0, std::move(request));
  }

 private:
  const Arms& arms_;
  const HostTime begun_ = host_now();
};

class AnsweredArms final : public HardwareArms {
 public:
  AnsweredArms(const Scene& scene, std::function<void(const std::string&)> report) : backend_(arms_) {
    if (report) {
      report = [mutex = std::make_shared<std::mutex>(), say = std::move(report)](const std::string& text) {
        const std::lock_guard lock(*mutex);  // of the arms' own threads, off the loops
        say(text);
      };
    }
    for (const SceneArm& arm : scene.arms) {
      if (!arm.fci) throw std::invalid_argument("arm '" + arm.name + "' has no address (robot_ip, or fci)");
      arms_.push_back(std::make_unique<AnsweredArm>(fci::fci_arm_config(arm, arm.fci->address), arm, report));
    }
  }
  ~AnsweredArms() override { disconnect(); }

  Backend& backend() override { return backend_; }

  void connect() override {
    std::vector<std::future<std::string>> results;
    try {
      for (const auto& arm : arms_) results.push_back(arm->enter());
    } catch (...) {  // no thread could be started for an arm
      disconnect();
      throw;
    }
    std::string why;
    for (auto& result : results) {
      const std::string text = result.get();
      if (!text.empty()) why += (why.empty() ? "" : "\n") + text;
    }
    if (why.empty()) return;
    disconnect();
    throw std::runtime_error(why);
  }
  void disconnect() override {
    for (const auto& arm : arms_) arm->set_drive(ArmDrive::none);
    for (const auto& arm : arms_) arm->begin_leaving();
    for (const auto& arm : arms_) arm->leave();
  }

  ArmSet update() noexcept override {
    ArmSet fresh;
    for (ArmIndex i = 0; i < arms_.size(); ++i) {
      const std::uint64_t before = arms_[i]->report().state.sequence;
      if (arms_[i]->take_report() && arms_[i]->report().state.sequence != before) fresh |= ArmSet::of(i);
    }
    return fresh;
  }
  double set_time(std::int64_t stamp_ns) noexcept override {
    constexpr double kLongest = 0.01;  // [s]
    const double passed = seconds(std::chrono::nanoseconds(stamp_ns - stamp_ns_));
    stamp_ns_ = stamp_ns;
    return std::clamp(passed, 0.0, kLongest);
  }
  void set_drive(ArmIndex arm, ArmDrive drive) noexcept override { arms_[arm]->set_drive(drive); }
  bool is_driven(ArmIndex arm, ArmDrive drive) noexcept override {
    return arms_[arm]->report().running == drive && arms_[arm]->report().state.mode == ArmMode::move;
  }
  bool take_restart(ArmIndex arm) noexcept override { return arms_[arm]->take_restart(); }
  bool follows(ArmIndex arm) const noexcept override { return arms_[arm]->report().follows; }
  Desired desired(ArmIndex arm) const noexcept override { return arms_[arm]->report().desired; }

  void command(ArmIndex arm, const InterfaceCommand& command) noexcept override {
    const auto values = [](const auto& v) { return std::span(v.data(), static_cast<std::size_t>(v.size())); };
    switch (arms_[arm]->report().running) {
      case ArmDrive::joint_position:
        return arms_[arm]->command(stamp_ns_, values(command.q_c));
      case ArmDrive::joint_velocity:
        return arms_[arm]->command(stamp_ns_, values(command.dq_c));
      case ArmDrive::cartesian_pose:
        return arms_[arm]->command(stamp_ns_, command.O_T_EE_c);
      case ArmDrive::cartesian_velocity:
        return arms_[arm]->command(stamp_ns_, values(command.O_dP_EE_c));
      case ArmDrive::none:
      case ArmDrive::effort:
        return;
    }
  }
  void stop(ArmIndex arm) noexcept override { arms_[arm]->set_drive(ArmDrive::none); }
  void write(ArmSet effort, std::span<const ArmCommand> commands) noexcept override {
    for (ArmIndex i = 0; i < arms_.size(); ++i) {
      if (!effort.contains(i)) continue;
      (void)arms_[i]->take_restart();  // torques act at once, faded in
      const JointVector& tau = commands[i].tau_cmd;
      arms_[i]->command(stamp_ns_, std::span(tau.data(), static_cast<std::size_t>(tau.size())));
    }
  }

 private:
  Arms arms_;
  AnsweredBackend backend_;
  std::int64_t stamp_ns_ = 0;  // the program's clock
};

}  // namespace

std::unique_ptr<HardwareArms> answered_arms(const Scene& scene,
                                            std::function<void(const std::string&)> report) {
  return std::make_unique<AnsweredArms>(scene, std::move(report));
}

}  // namespace multipanda

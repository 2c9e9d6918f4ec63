#include <random>
#include <stdexcept>
#include <thread>

#include <fmt/format.h>

#include "benchmarks/cases.hpp"

namespace multipanda::bench {
namespace {

using std::chrono::microseconds;

// Runs the loop in a thread for the lifetime of this object.
class Running {
 public:
  Running(MotionLoop& loop, std::vector<SetupStep>& steps) : loop_(loop) {
    thread_ = std::thread([this, &steps] {
      steps = set_up_thread({});
      ready_.store(true, std::memory_order_release);
      loop_.world.start();
      loop_.cycle.run([this] { return !end_.load(std::memory_order_acquire); });
    });
    while (!ready_.load(std::memory_order_acquire)) std::this_thread::sleep_for(microseconds(100));
  }
  ~Running() {
    end_.store(true, std::memory_order_release);
    thread_.join();
  }

 private:
  MotionLoop& loop_;
  std::atomic<bool> ready_{false}, end_{false};
  std::thread thread_;
};

double trial_ms(MultimodeController& modes, const Request& request) {
  Answer answer;
  std::uint64_t ticket = 0;
  const HostTime sent = host_now();
  answer.verdict = modes.post(std::span(&request, 1), ticket);
  while (answer.accepted() && !modes.poll(ticket, answer)) {
    if (seconds(host_now() - sent) > 1.0) answer.verdict = Verdict::timeout;
    std::this_thread::sleep_for(microseconds(50));
  }
  if (!answer.accepted()) {
    throw std::runtime_error(fmt::format("switching: {}", std::string(to_string(answer.verdict))));
  }
  return seconds(answer.first_torque - sent) * 1e3;
}

}  // namespace

SwitchTimes measure_switching(const Arms& arms, const Registry& registry, std::size_t trials,
                              const Filter& selected) {
  MotionLoop loop(arms, 2,
                  {{.name = "left", .type = "cartesian_impedance", .arms = {0}},
                   {.name = "right", .type = "cartesian_impedance", .arms = {1}},
                   {.name = "both", .type = "dual_cartesian_impedance", .arms = {0, 1}}},
                  registry, SmoothMotion::Pace::realtime);
  const InstanceSet apart = loop.set({"left", "right"}), together = loop.set({"both"});
  loop.activate(together);

  MultimodeController& modes = loop.cycle.modes();
  const InstanceIndex both = modes.find("both");
  const auto joint_limits = static_cast<std::uint16_t>(modes.instance(both).find_feature("joint_limits"));
  std::mt19937_64 random(1);
  std::uniform_int_distribution<int> pause_us(1000, 3000);
  const auto run = [&](const std::string& what, std::vector<double>& trials_ms, auto request_of) {
    if (!selected("switch_ms/" + what)) return;
    for (std::size_t i = 0; i < trials; ++i) {
      std::this_thread::sleep_for(microseconds(pause_us(random)));
      trials_ms.push_back(trial_ms(modes, request_of(i % 2 == 0)));
    }
  };

  SwitchTimes times;
  const Running running(loop, times.loop_thread);
  run("feature", times.trials_ms["feature"], [&](bool on) {
    return Request{.kind = Request::Kind::set_feature, .instance = both, .index = joint_limits, .on = on};
  });
  run("controllet", times.trials_ms["controllet"],
      [&](bool even) { return Request{.activate = even ? apart : together}; });
  return times;
}

}  // namespace multipanda::bench

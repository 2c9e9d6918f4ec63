#pragma once

// An arm and a program that commands it, each by a clock of its own, in simulated time; seeded.
#include <algorithm>
#include <cmath>
#include <cstdint>
#include <functional>
#include <random>

#include "core/testing/series.hpp"

namespace multipanda::test {

struct ClocksConfig {
  double drift_ppm = 0;        // of the arm's clock against the program's
  std::int64_t phase_ns = 0;   // of the arm's first packet
  std::int64_t jitter_ns = 0;  // the program wakes up to so late, each cycle
  std::int64_t update_ns = 0;  // it stamps a command up to so much after the instant that it computed it for
  std::int64_t compute_ns = 150'000;  // until its command is visible
  std::int64_t stall_ns = 5'000'000;  // a long delay of a cycle
  double stalls_per_s = 0;
  double loss = 0;  // share of the answers that do not reach the arm
  std::uint32_t seed = 1;
};

// The events in their order: the program's cycles at 1 kHz, as ros2_control's node sleeps (an absolute grid;
// a cycle that is late skips those that it missed), and the arm's packets.
class TwoClocks {
 public:
  explicit TwoClocks(const ClocksConfig& config) : config_(config), random_(config.seed) {
    packet_ns_ = config.phase_ns;
    wake();
  }
  // The program's cycle: the instant that its command is for, and the command's stamp, on its clock [ns].
  std::function<void(std::int64_t now, std::int64_t stamp)> cycle;
  // Its command becomes visible to the arm's thread.
  std::function<void()> publish;
  // The arm's packet; `lost`: the answer does not reach it.
  std::function<void(bool lost)> packet;
  bool program_runs = true;

  // Until the arm has sent so many packets more.
  void run(int packets) {
    for (int k = 0; k < packets;) {
      const std::int64_t program = visible_ ? wake_ns_ : done_ns();
      if (program < packet_ns_) {
        step_program();
        continue;
      }
      packet(draw_(random_) < config_.loss);
      ++count_;
      const double period = 1e6 * (1 + 1e-6 * config_.drift_ppm);
      packet_ns_ =
          config_.phase_ns + static_cast<std::int64_t>(std::llround(period * static_cast<double>(count_)));
      ++k;
    }
  }
  // The arm's last packet, on the program's clock [s].
  double now() const { return 1e-9 * static_cast<double>(packet_ns_); }

 private:
  void step_program() {
    if (visible_) {
      visible_ = false;
      if (program_runs) cycle(wake_ns_, wake_ns_ + update_ns_);
      return;
    }
    visible_ = true;
    if (program_runs) publish();
    do {
      grid_ns_ += 1'000'000;
    } while (grid_ns_ < done_ns());
    wake();
  }
  void wake() {
    wake_ns_ = grid_ns_ + static_cast<std::int64_t>(draw_(random_) * static_cast<double>(config_.jitter_ns));
    update_ns_ = 0;
    const bool stalls = draw_(random_) < 1e-3 * config_.stalls_per_s;
    if (config_.update_ns == 0) {
      if (stalls) wake_ns_ += config_.stall_ns;
      return;
    }
    update_ns_ = static_cast<std::int64_t>(draw_(random_) * static_cast<double>(config_.update_ns));
    if (stalls) (draw_(random_) < 0.5 ? wake_ns_ : update_ns_) += config_.stall_ns;
  }
  std::int64_t done_ns() const { return wake_ns_ + update_ns_ + config_.compute_ns; }

  ClocksConfig config_;
  std::mt19937 random_;
  std::uniform_real_distribution<double> draw_{0, 1};
  std::int64_t grid_ns_ = 0, wake_ns_ = 0, update_ns_ = 0, packet_ns_ = 0, count_ = 0;
  bool visible_ = true;  // the last command is; the next event is a wake-up
};

// Motions of one coordinate from rest to rest, quintics as a trajectory controller interpolates points with
// velocities and accelerations; seeded goals.
class Quintics {
 public:
  struct Limits {
    double range = 0.5;  // about the start
    double velocity = 1, acceleration = 1, jerk = 1;
  };
  Quintics(double start, const Limits& limits, std::uint32_t seed)
      : limits_(limits), start_(start), from_(start), to_(start), random_(seed) {}

  // At the time t, which never decreases [s]; the velocity, too.
  double at(double t, double& velocity) {
    while (t >= begin_ + duration_) next();
    const double s = std::clamp((t - begin_) / duration_, 0.0, 1.0), d = to_ - from_;
    velocity = d / duration_ * 30 * s * s * (1 - s) * (1 - s);
    return from_ + d * s * s * s * (10 + s * (6 * s - 15));
  }

 private:
  void next() {
    begin_ += duration_;
    from_ = to_;
    std::uniform_real_distribution<double> draw(0, 1);
    const double kind = draw(random_);
    if (kind < 0.1) {  // a rest
      duration_ = 0.1 + draw(random_);
      return;
    }
    to_ = start_ + limits_.range * (2 * draw(random_) - 1);
    const double d = std::abs(to_ - from_), speed = kind < 0.4 ? 0.05 + 0.2 * draw(random_) : 1;
    const double v = speed * limits_.velocity, a = speed * limits_.acceleration;
    duration_ = std::max({0.05, 1.875 * d / v, std::sqrt(5.774 * d / a), std::cbrt(60 * d / limits_.jerk)});
  }

  Limits limits_;
  double start_, from_, to_, begin_ = 0, duration_ = 0.5;
  std::mt19937 random_;
};

// Arm time of one trial [s]: ten minutes in the full series, otherwise what a quick test takes.
inline double trial_seconds(const Series& series, double quick) { return series.full() ? 600 : quick; }

}  // namespace multipanda::test

#include "tests/teleoperation/figures.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <complex>
#include <memory>
#include <random>

namespace multipanda::teleoperation {
namespace {

// From 0 at `from` to 1 at `to`, without a step of the velocity.
double rise(double t, double from, double to) {
  const double u = std::clamp((t - from) / (to - from), 0.0, 1.0);
  return u * u * u * (10 + u * (6 * u - 15));
}

std::string fault_of(const Outcome& outcome) {
  return outcome.kept && outcome.fault.empty() ? "" : outcome.fault + outcome.rules;
}

}  // namespace

FreeMotion free_motion(Trial trial) {
  trial.table_n_per_m = 0;
  trial.duration_s = 8;
  trial.way = [size = std::min(1.0, trial.scale)](double t) -> Vector3 {
    const double a = size * rise(t, 0.5, 2.5);
    return a * Vector3(0.05 * std::sin(2.4 * t), 0.06 * (1 - std::cos(1.9 * t)), 0.04 * std::sin(2.9 * t));
  };
  const Outcome outcome = run(trial);
  FreeMotion found;
  found.fault = fault_of(outcome);
  for (const Sample& s : outcome.samples) {
    found.largest_error = std::max(found.largest_error, s.error.norm());
    found.largest_felt = std::max(found.largest_felt, s.felt.norm());
  }
  return found;
}

Contact contact(Trial trial) {
  trial.duration_s = 8;
  trial.way = [](double t) {
    const double depth = kGap + 0.02;
    return Vector3(0, 0, -depth * rise(t, 0.5, 2.5) - 0.03 * rise(t, 4, 5));
  };
  const Outcome outcome = run(trial);
  Contact found;
  found.fault = fault_of(outcome);
  for (const Sample& s : outcome.samples) {
    const double F = s.contact.norm();
    found.peak = std::max(found.peak, F);
    if (s.t > 7.5) found.pressed = F;
    if (F > 5 && s.t > 3) found.error = std::max(found.error, std::abs(s.felt.norm() - F) / F);
  }
  return found;
}

Response response(double frequency_hz) {
  const double w = 2 * M_PI * frequency_hz;
  const double amplitude = std::min(0.03, 0.1 / w);
  Trial trial;
  trial.duration_s = 3 + 4 / frequency_hz;
  trial.way = [=](double t) { return Vector3(0, 0, amplitude * rise(t, 0.3, 2) * std::sin(w * t)); };
  const Outcome outcome = run(trial);
  // Over whole periods at the end, both hands along z, to which R_map is the identity.
  std::complex<double> led = 0, followed = 0;
  const double from = 3;
  for (const Sample& s : outcome.samples) {
    if (s.t < from) continue;
    const std::complex<double> turn(std::cos(w * s.t), -std::sin(w * s.t));
    led += s.led.z() * turn;
    followed += (s.led.z() - s.error.z()) * turn;
  }
  const std::complex<double> H = followed / led;
  return {std::abs(H), std::arg(H)};
}

Trial disturbed(Trial trial, std::uint32_t seed) {
  std::mt19937 random(seed);
  const auto between = [&random](double a, double b) {
    return std::uniform_real_distribution<double>(a, b)(random);
  };
  struct Stop {
    double at;
    Vector3 p;
    bool holds;
  };
  auto stops = std::make_shared<std::vector<Stop>>();
  const auto place = [&] {
    const double z = between(-0.05, 0.02), y = between(-0.04, 0.04);
    return Vector3(between(-0.04, 0.04), y, z);
  };
  for (double t = 0.5; t < 8; t += between(0.4, 1.0)) {
    stops->push_back({t, place(), between(0, 1) > 0.15});
  }
  const auto current = [stops](double t) {
    std::size_t i = 0;
    while (i + 1 < stops->size() && (*stops)[i + 1].at <= t) ++i;
    return i;
  };
  trial.duration_s = 8;
  trial.way = [stops, current](double t) -> Vector3 {
    const std::size_t i = current(t);
    if (t < (*stops)[0].at) return Vector3::Zero();
    const Vector3 before = i == 0 ? Vector3(Vector3::Zero()) : (*stops)[i - 1].p;
    return before + rise(t, (*stops)[i].at, (*stops)[i].at + 0.35) * ((*stops)[i].p - before);
  };
  trial.holds = [stops, current](double t) { return (*stops)[current(t)].holds; };
  return trial;
}

}  // namespace multipanda::teleoperation

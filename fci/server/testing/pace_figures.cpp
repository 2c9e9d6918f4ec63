// Speed of virtual arms in lock-step, and their regularity in real time: the tables of
// docs/results/virtual_arms.md.
//   virtual_arm_figures [SECONDS]
// The programs are minimal: bare sockets in a separate process that answer every state at once.
#include <algorithm>
#include <cstdio>
#include <cstdlib>
#include <numeric>
#include <sys/wait.h>

#include "backends/mujoco/testing/test_scenes.hpp"
#include "core/rt/pacer.hpp"
#include "fci/server/testing/test_program.hpp"

namespace multipanda::fci {
namespace {

using test::TestProgram;

Scene scene_with(std::size_t arms) {
  std::vector<SceneArm> list;
  for (std::size_t i = 0; i < arms; ++i) {
    list.push_back(multipanda::test::arm_named("arm" + std::to_string(i + 1),
                                               multipanda::test::pose(0, static_cast<double>(i), 0)));
  }
  return multipanda::test::scene_of(std::move(list));
}

VirtualArmOptions options(std::size_t arms, WorldPace pace) {
  VirtualArmOptions result;
  for (std::size_t i = 0; i < arms; ++i) {
    result.places.push_back({.address = test::own_address(static_cast<int>(i)),
                             .port = 0,
                             .gripper_port = 0,
                             .vacuum_port = 0,
                             .versions = VersionRange{}});
  }
  result.pace = pace;
  return result;
}

struct Quantiles {
  double mean = 0, p50 = 0, p99 = 0, p999 = 0;
};
Quantiles quantiles(std::vector<double> values) {
  std::sort(values.begin(), values.end());
  const auto at = [&](double share) {
    return values[static_cast<std::size_t>(share * static_cast<double>(values.size() - 1))];
  };
  return {std::accumulate(values.begin(), values.end(), 0.0) / static_cast<double>(values.size()), at(0.5),
          at(0.99), at(0.999)};
}

// In a separate process, so that it shares only the sockets with the arms. Its results return as numbers.
template <typename Work>
std::vector<double> in_a_process(Work work) {
  int ends[2];
  if (::pipe(ends) != 0) std::abort();
  const pid_t child = ::fork();
  if (child == 0) {
    const std::vector<double> result = work();
    for (std::size_t sent = 0; sent < result.size() * sizeof(double);) {
      const auto n = ::write(ends[1], reinterpret_cast<const char*>(result.data()) + sent,
                             result.size() * sizeof(double) - sent);
      if (n <= 0) break;
      sent += static_cast<std::size_t>(n);
    }
    ::_exit(0);
  }
  ::close(ends[1]);
  std::vector<double> result;
  double value = 0;
  for (std::size_t have = 0;;) {
    const auto n = ::read(ends[0], reinterpret_cast<char*>(&value) + have, sizeof(value) - have);
    if (n <= 0) break;
    have += static_cast<std::size_t>(n);
    if (have < sizeof(value)) continue;
    result.push_back(value);
    have = 0;
  }
  ::close(ends[0]);
  ::waitpid(child, nullptr, 0);
  return result;
}

// Both ends of the connection alone: the bytes of a state in one direction and of a command in the other.
double round_trip_us(int rounds) {
  const std::string here = test::own_address(9);
  Socket a(::socket(AF_INET, SOCK_DGRAM | SOCK_CLOEXEC, 0)),
      b(::socket(AF_INET, SOCK_DGRAM | SOCK_CLOEXEC, 0));
  for (Socket* socket : {&a, &b}) {
    const sockaddr_in any = ipv4(here, 0);
    ::bind(socket->file(), reinterpret_cast<const sockaddr*>(&any), sizeof(any));
  }
  const auto join = [&](Socket& from, const Socket& to) {
    const sockaddr_in there = ipv4(here, port_of(to));
    ::connect(from.file(), reinterpret_cast<const sockaddr*>(&there), sizeof(there));
  };
  join(a, b);
  join(b, a);
  std::array<std::byte, 2400> bytes{};
  const pid_t child = ::fork();
  if (child == 0) {
    while (::recv(b.file(), bytes.data(), bytes.size(), 0) > 1) ::send(b.file(), bytes.data(), 371, 0);
    ::_exit(0);
  }
  const HostTime begin = host_now();
  for (int i = 0; i < rounds; ++i) {
    ::send(a.file(), bytes.data(), 1377, 0);
    while (::recv(a.file(), bytes.data(), bytes.size(), MSG_DONTWAIT) < 0) {
    }
  }
  const double us = 1e6 * seconds(host_now() - begin) / rounds;
  ::send(a.file(), bytes.data(), 1, 0);
  ::waitpid(child, nullptr, 0);
  return us;
}

// A period of the world without any network: the engine, and the engine with the arms' own behavior.
struct BarePeriod {
  double mj_step_us = 0, advance_us = 0;
};
BarePeriod bare_period(std::size_t arms, int periods) {
  MujocoPlant plant(scene_with(arms));
  const auto time = [&](auto work) {
    const HostTime begin = host_now();
    for (int i = 0; i < periods; ++i) work();
    return 1e6 * seconds(host_now() - begin) / periods;
  };
  BarePeriod result;
  result.advance_us = time([&] {
    for (ArmIndex i = 0; i < arms; ++i) plant.arm(i).take_command(joint_constant(7, 0));
    plant.advance();
  });
  result.mj_step_us = time([&] { mj_step(plant.world().model(), plant.world().data()); });
  return result;
}

void lockstep(std::size_t arms, int periods) {
  const BarePeriod bare = bare_period(arms, periods);
  const double loopback_us = round_trip_us(periods);
  VirtualArms world(scene_with(arms), options(arms, WorldPace::lockstep));
  world.start();
  const auto places = [&] {
    std::vector<ArmPlace> result;
    for (ArmIndex i = 0; i < arms; ++i) result.push_back(world.place(i));
    return result;
  }();
  // Wall time per period, and the program's own part of it.
  const auto measured = in_a_process([&]() -> std::vector<double> {
    std::vector<std::unique_ptr<TestProgram>> programs;
    std::vector<RobotState> states(arms);
    for (const auto& place : places) programs.push_back(std::make_unique<TestProgram>(place));
    for (std::size_t i = 0; i < arms; ++i) states[i] = programs[i]->begin_torques();
    for (std::size_t i = 0; i < arms; ++i) states[i] = programs[i]->read_newest_or(states[i]);
    HostTime begin = host_now();
    double own = 0;
    for (int n = -100; n < periods; ++n) {
      if (n == 0) {
        begin = host_now();
        own = 0;
      }
      for (std::size_t i = 0; i < arms; ++i) programs[i]->command(programs[i]->torques(states[i]));
      for (std::size_t i = 0; i < arms; ++i) {
        states[i] = programs[i]->read_spinning();
        if (n < 0) states[i] = programs[i]->read_newest_or(states[i]);  // until all are synchronized
        own += programs[i]->decoding_s();
      }
    }
    const double wall = seconds(host_now() - begin);
    return {1e6 * wall / periods, 1e6 * own / periods};
  });
  const auto missed = world.statistics(0).commands_missed;
  world.stop();
  if (measured.size() < 2) {
    std::printf("lock-step, %zu arms: the program failed\n", arms);
    return;
  }
  const double n = static_cast<double>(arms);
  const double bound = bare.mj_step_us + n * loopback_us + measured[1];
  std::printf(
      "lock-step, %zu arm%s: %.1f us per period = %.1f x real time (missed: %llu); mj_step %.1f, with the "
      "arms' own behavior %.1f, loopback round trip %.1f each, program %.1f us; %.0f %% of 1/(mj_step + "
      "round trips + program)\n",
      arms, arms == 1 ? "" : "s", measured[0], 1000 / measured[0], static_cast<unsigned long long>(missed),
      bare.mj_step_us, bare.advance_us, loopback_us, measured[1], 100 * bound / measured[0]);
}

void print_periods(const char* what, const std::vector<double>& us) {
  const Quantiles q = quantiles(us);
  std::printf("%-34s mean %8.2f us (%8.3f Hz)  p50 %8.1f  p99 %8.1f  p99.9 %8.1f us\n", what, q.mean,
              1e6 / q.mean, q.p50, q.p99, q.p999);
}

// When states arrive at a program, and of a timer of 1 ms with nothing to do, at the same time.
void realtime(std::size_t arms, int periods) {
  VirtualArms world(scene_with(arms), options(arms, WorldPace::realtime));
  world.start();
  std::vector<double> timer;
  const ArmPlace place = world.place(0);
  std::thread beside([&] {
    Pacer pacer;
    pacer.start();
    HostTime before{};
    for (int i = 0; i < periods; ++i) {
      pacer.wait();
      const HostTime now = host_now();
      if (i > 0) timer.push_back(1e6 * seconds(now - before));
      before = now;
    }
  });
  const auto arrivals = in_a_process([&]() -> std::vector<double> {
    TestProgram program(place);
    std::vector<double> us;
    RobotState state = program.start_torques();
    HostTime before = host_now();
    for (int i = 0; i < periods; ++i) {
      state = program.exchange(state);
      const HostTime now = host_now();
      us.push_back(1e6 * seconds(now - before));
      before = now;
    }
    return us;
  });
  beside.join();
  const auto counts = world.statistics(0);
  world.stop();
  if (arrivals.empty()) {
    std::printf("real time: the program failed\n");
    return;
  }
  char what[64];
  std::snprintf(what, sizeof(what), "real time, %zu arm%s: states arrive", arms, arms == 1 ? "" : "s");
  print_periods(what, arrivals);
  print_periods("  a bare timer of 1 ms for comparison", timer);
  std::printf("  commands used %llu, late %llu, missed %llu, ms given up %llu\n",
              static_cast<unsigned long long>(counts.commands_used),
              static_cast<unsigned long long>(counts.commands_late),
              static_cast<unsigned long long>(counts.commands_missed),
              static_cast<unsigned long long>(world.world_statistics().overruns));
}

}  // namespace
}  // namespace multipanda::fci

int main(int argc, char** argv) {
  const double s = argc > 1 ? std::atof(argv[1]) : 10;
  const int periods = std::max(200, static_cast<int>(1000 * s));
  for (const std::size_t arms : {1, 2}) multipanda::fci::lockstep(arms, periods);
  for (const std::size_t arms : {1, 2}) multipanda::fci::realtime(arms, periods);
  return 0;
}

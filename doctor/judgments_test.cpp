// Judgments as pure functions of readings, the named causes, and the display of findings.
#include <functional>
#include <limits>
#include <map>

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <nlohmann/json.hpp>

#include "doctor/arm_stream.hpp"
#include "doctor/computer.hpp"
#include "doctor/examination.hpp"
#include "doctor/finding.hpp"

namespace multipanda::doctor::judgments_test {
namespace {

using testing::HasSubstr;

constexpr auto kReal = Purpose::real_arms;
constexpr auto kSimulated = Purpose::simulated_arms;

// One row: a reading, and how it must be judged for real and for simulated arms.
struct Row {
  const char* what;
  std::function<Finding(Purpose)> judge;
  Judgment real, simulated;
};

template <typename Reading>
auto judged(Finding (*judge)(const Reading&, Purpose), Reading reading) {
  return [judge, reading](Purpose purpose) { return judge(reading, purpose); };
}

// `late` of 1000 wake-ups come after 400 us, the others after 5 us.
TimerReading timer(std::size_t late, std::uint64_t missed = 0, std::uint64_t in_row = 0) {
  TimerReading reading{
      .late_us = std::vector<double>(1000, 5.0), .missed = missed, .missed_in_row = in_row, .setup = {}};
  std::fill_n(reading.late_us.begin(), late, 400.0);
  return reading;
}

RoundTripReading trip(std::size_t slow, std::size_t lost) {
  RoundTripReading reading{.address = "10.0.0.2", .method = "echo", .reason = {}, .us = {}, .sent = 1000};
  reading.us.assign(1000 - lost, 150.0);
  std::fill_n(reading.us.begin(), slow, 350.0);
  return reading;
}

NetworkCardReading card() {
  return {.address = "10.0.0.2",
          .interface = "eth1",
          .reason = {},
          .gateway = {},
          .mtu = 1500,
          .speed = 1000,
          .coalesce_us = 3};
}

template <typename Change>
NetworkCardReading card_with(Change change) {
  NetworkCardReading reading = card();
  change(reading);
  return reading;
}

ControlCycleReading cycle(double p50, double p999) {
  return {.scene = "s",
          .reason = {},
          .cycles = 1000,
          .p50 = p50,
          .p99 = p999,
          .p999 = p999,
          .worst = p999,
          .guarded = true,
          .memory_locked = true};
}

template <typename Change>
ControlCycleReading guarded(Change change) {
  ControlCycleReading reading = cycle(10, 20);
  change(reading);
  return reading;
}

SchedulingReading given() {
  return {.fifo = true,
          .priority_limit = 99,
          .memory_locks = true,
          .memory_unlimited = true,
          .rt_runtime_us = 950000,
          .rt_period_us = 1e6};
}

template <typename Change>
SchedulingReading scheduling(Change change) {
  SchedulingReading reading = given();
  change(reading);
  return reading;
}

LoadReading load(std::vector<double> cores, std::optional<double> steal = 0.0) {
  return {.cores = std::move(cores),
          .steal = steal,
          .processes = {{42, "hungry", 0.9}},
          .isolated = {},
          .tickless = {}};
}

ProcessorReading governed(std::map<std::string, int> governors, double idle_us = 10) {
  return {.governors = std::move(governors),
          .slowest_mhz = 800,
          .fastest_mhz = 4000,
          .max_mhz = 4200,
          .turbo = true,
          .idle_states = {{"POLL", 0, true}, {"C6", idle_us, true}, {"C10", 900, false}}};
}

TEST(DoctorJudges, ReadingsAsTheTableSays) {
  constexpr auto ok = Judgment::ok, unknown = Judgment::unknown, warning = Judgment::warning,
                 bad = Judgment::bad;
  const std::vector<Row> rows{
      {"RT kernel", judged(judge_kernel, KernelReading{"6.1", "#1 SMP PREEMPT_RT", 1}), ok, ok},
      {"RT kernel by its flag", judged(judge_kernel, KernelReading{"5.9", "#1 SMP", 1}), ok, ok},
      {"RT by name only", judged(judge_kernel, KernelReading{"6.1", "#1 SMP PREEMPT_RT", {}}), warning,
       warning},
      {"plain kernel", judged(judge_kernel, KernelReading{"6.1", "#1 SMP PREEMPT_DYNAMIC", {}}), bad,
       warning},
      {"flag 0", judged(judge_kernel, KernelReading{"6.1", "#1 SMP", 0}), bad, warning},

      {"FIFO", judged(judge_fifo, given()), ok, ok},
      {"no FIFO", judged(judge_fifo, scheduling([](auto& r) {
                           r.fifo = false;
                           r.fifo_error = EPERM;
                         })),
       bad, warning},
      {"memory", judged(judge_memory_lock, given()), ok, ok},
      {"memory limited", judged(judge_memory_lock, scheduling([](auto& r) { r.memory_unlimited = false; })),
       bad, warning},
      {"memory refused", judged(judge_memory_lock, scheduling([](auto& r) { r.memory_locks = false; })), bad,
       warning},
      {"throttled at 95 %", judged(judge_throttling, given()), ok, ok},
      {"throttling off", judged(judge_throttling, scheduling([](auto& r) { r.rt_runtime_us = -1; })), ok, ok},
      {"throttled at 10 %", judged(judge_throttling, scheduling([](auto& r) { r.rt_runtime_us = 1e5; })), bad,
       warning},
      {"throttling closed", judged(judge_throttling, scheduling([](auto& r) { r.rt_runtime_us.reset(); })),
       unknown, unknown},

      {"performance", judged(judge_governor, governed({{"performance", 8}})), ok, ok},
      {"one core saves", judged(judge_governor, governed({{"performance", 7}, {"powersave", 1}})), bad,
       warning},
      {"no governor", judged(judge_governor, ProcessorReading{}), unknown, unknown},
      {"light sleep", judged(judge_idle_states, governed({}, 10)), ok, ok},
      {"deep sleep", judged(judge_idle_states, governed({}, 133)), warning, warning},
      {"no idle states", judged(judge_idle_states, ProcessorReading{}), unknown, unknown},

      {"own computer", judged(judge_virtual_machine, MachineKindReading{.cores = 8, .hypervisor = false}), ok,
       ok},
      {"virtual", judged(judge_virtual_machine, MachineKindReading{.cores = 8, .hypervisor = true}), bad,
       warning},
      {"not told", judged(judge_virtual_machine, MachineKindReading{.cores = 8}), unknown, unknown},
      {"quick clock",
       judged(judge_clock_source, MachineKindReading{.clock_source = "tsc", .clock_read_ns = 30}), ok, ok},
      {"slow clock",
       judged(judge_clock_source, MachineKindReading{.clock_source = "hpet", .clock_read_ns = 1500}), warning,
       warning},
      {"very slow clock", judged(judge_clock_source, MachineKindReading{.clock_read_ns = 9000}), bad,
       warning},

      {"idle", judged(judge_load, load({0.1, 0.2, 0.3})), ok, ok},
      {"half a core left", judged(judge_load, load({1.0, 0.5})), warning, warning},
      {"nothing left", judged(judge_load, load({1.0, 0.9})), bad, warning},
      {"one core, idle", judged(judge_load, load({0.2})), ok, ok},
      {"no counters", judged(judge_load, load({})), unknown, unknown},
      {"no steal", judged(judge_steal, load({0.1}, 0.0)), ok, ok},
      {"some steal", judged(judge_steal, load({0.1}, 0.005)), warning, warning},
      {"much steal", judged(judge_steal, load({0.1}, 0.05)), bad, warning},
      {"steal unknown", judged(judge_steal, load({}, {})), unknown, unknown},

      {"on time", judged(judge_timer, timer(0)), ok, ok},
      {"a few late", judged(judge_timer, timer(10)), warning, warning},
      {"many late", judged(judge_timer, timer(11)), bad, warning},
      {"a few missed", judged(judge_timer, timer(0, 19, 19)), warning, warning},
      {"20 in a row", judged(judge_timer, timer(0, 20, 20)), bad, warning},
      {"not measured", judged(judge_timer, TimerReading{}), unknown, unknown},

      {"good card", judged(judge_network_card, card()), ok, ok},
      {"no route", judged(judge_network_card, NetworkCardReading{.address = "x"}), bad, bad},
      {"itself", judged(judge_network_card, card_with([](auto& r) { r.loopback = true; })), ok, ok},
      {"wireless", judged(judge_network_card, card_with([](auto& r) { r.wireless = true; })), bad, warning},
      {"10 Mbit", judged(judge_network_card, card_with([](auto& r) { r.speed = 10; })), bad, warning},
      {"100 Mbit", judged(judge_network_card, card_with([](auto& r) { r.speed = 100; })), ok, ok},
      {"half duplex", judged(judge_network_card, card_with([](auto& r) { r.full_duplex = false; })), bad,
       warning},
      {"routed", judged(judge_network_card, card_with([](auto& r) { r.gateway = "10.0.0.1"; })), warning,
       warning},
      {"small packets", judged(judge_network_card, card_with([](auto& r) { r.mtu = 1280; })), warning,
       warning},
      {"collects", judged(judge_network_card, card_with([](auto& r) { r.coalesce_us = 100; })), warning,
       warning},
      {"damaged", judged(judge_network_card, card_with([](auto& r) { r.damaged = 3; })), warning, warning},
      {"usb", judged(judge_network_card, card_with([](auto& r) { r.usb = true; })), warning, warning},

      {"quick trip", judged(judge_round_trip, trip(0, 0)), ok, ok},
      {"one slow", judged(judge_round_trip, trip(1, 0)), warning, warning},
      {"one lost", judged(judge_round_trip, trip(0, 1)), warning, warning},
      {"2 % slow", judged(judge_round_trip, trip(20, 0)), bad, warning},
      {"2 % lost", judged(judge_round_trip, trip(0, 20)), bad, warning},
      {"nobody", judged(judge_round_trip, RoundTripReading{.address = "x"}), bad, bad},

      {"quick cycle", judged(judge_control_cycle, cycle(20, 90)), ok, ok},
      {"slow tail", judged(judge_control_cycle, cycle(20, 2000)), warning, warning},
      {"slow itself", judged(judge_control_cycle, cycle(200, 400)), warning, warning},
      {"too slow", judged(judge_control_cycle, cycle(900, 1200)), bad, warning},
      {"no scene", judged(judge_control_cycle, ControlCycleReading{.scene = "s", .reason = "no file"}),
       unknown, unknown},
      {"guard content", judged(judge_loop_guard, cycle(10, 20)), ok, ok},
      {"allocates", judged(judge_loop_guard, guarded([](auto& r) { r.heap_calls = 1; })), bad, warning},
      {"locks", judged(judge_loop_guard, guarded([](auto& r) { r.lock_calls = 1; })), bad, warning},
      {"faults", judged(judge_loop_guard, guarded([](auto& r) { r.page_faults = 1; })), warning, warning},
      {"faults unlocked", judged(judge_loop_guard, guarded([](auto& r) {
                                   r.page_faults = 1;
                                   r.memory_locked = false;
                                 })),
       unknown, unknown},
      {"no guard", judged(judge_loop_guard, guarded([](auto& r) { r.guarded = false; })), unknown, unknown},

      {"no ROS", judged(judge_dds, DdsReading{.domains = {}, .multicast_in = 0.2, .multicast_out = 0.1}), ok,
       ok},
      {"quiet ROS", judged(judge_dds, DdsReading{.domains = {0}, .multicast_in = 20, .multicast_out = 10}),
       ok, ok},
      {"busy ROS", judged(judge_dds, DdsReading{.domains = {0}, .multicast_in = 400, .multicast_out = 10}),
       warning, warning},
      {"flood", judged(judge_dds, DdsReading{.domains = {3}, .multicast_in = 4000, .multicast_out = 10}), bad,
       warning},
  };
  for (const auto& row : rows) {
    for (const auto& [purpose, expected] :
         {std::pair(kReal, row.real), std::pair(kSimulated, row.simulated)}) {
      const Finding finding = row.judge(purpose);
      EXPECT_EQ(finding.judged, expected) << row.what << ": " << finding.measured;
      EXPECT_FALSE(finding.id.empty() || finding.subject.empty() || finding.measured.empty()) << row.what;
      // Every finding that is not ok has a cause and a cure.
      if (finding.judged == warning || finding.judged == bad) {
        EXPECT_FALSE(finding.cause.empty() || finding.cure.empty()) << row.what;
      } else if (finding.judged == ok) {
        EXPECT_TRUE(finding.cause.empty() && finding.cure.empty()) << row.what;
      }
    }
  }
}

// A test of `seconds` in which `slow` of 1000 periods lasted 2 ms.
CommunicationReading communication(double success, double least, std::uint64_t lost, std::size_t slow = 0) {
  CommunicationReading reading{
      .address = "10.0.0.2", .version = 10, .asked_s = 1, .periods = 1000, .answered = 1000};
  reading.lost = lost;
  reading.lost_in_row = lost;
  reading.success_min = least;
  reading.success_sum = success * 500;
  reading.success_count = 500;
  reading.cycle_us.assign(1000, 1000.0);
  std::fill_n(reading.cycle_us.begin(), slow, 2000.0);
  reading.answer_us.assign(1000, 10.0);
  return reading;
}

TEST(DoctorJudges, CommunicationTests) {
  constexpr auto ok = Judgment::ok, warning = Judgment::warning, bad = Judgment::bad;
  CommunicationReading stopped = communication(1, 1, 0);
  stopped.ended = "the arm stopped itself: communication_constraints_violation";
  stopped.errors = "communication_constraints_violation";
  const struct {
    const char* what;
    CommunicationReading reading;
    Judgment real, simulated;
  } rows[] = {{"perfect", communication(1, 1, 0), ok, ok},
              {"average low", communication(0.985, 0.95, 0), warning, warning},
              {"least low", communication(0.995, 0.85, 0), warning, warning},
              {"unusable", communication(0.85, 0.5, 0), bad, bad},
              {"one lost", communication(1, 1, 1), warning, warning},
              {"many lost", communication(1, 1, 20), bad, warning},
              {"irregular", communication(1, 1, 0, 20), bad, warning},
              {"stopped", stopped, bad, bad}};
  for (const auto& row : rows) {
    EXPECT_EQ(verdict(judge_communication(row.reading, kReal)), row.real) << row.what;
    EXPECT_EQ(verdict(judge_communication(row.reading, kSimulated)), row.simulated) << row.what;
  }
  EXPECT_THAT(judge_communication(stopped, kReal)[0].cure, HasSubstr("multipanda doctor 10.0.0.2"));
}

ArmStreamReading stream(std::uint64_t states, std::uint64_t lost, std::size_t irregular) {
  ArmStreamReading reading{.address = "10.0.0.2",
                           .version = 10,
                           .mode = "idle",
                           .seconds = 1,
                           .states = states,
                           .lost = lost,
                           .lost_in_row = lost};
  reading.gaps_us.assign(states - 1, 1000.0);
  std::fill_n(reading.gaps_us.begin(), irregular, 1400.0);
  return reading;
}

TEST(DoctorJudges, StatesOfArms) {
  constexpr auto ok = Judgment::ok, unknown = Judgment::unknown, warning = Judgment::warning,
                 bad = Judgment::bad;
  ArmStreamReading silent{.address = "x", .version = 10, .mode = "idle", .seconds = 1};
  ArmStreamReading unreachable{.address = "x", .reason = "refused"};
  ArmStreamReading stopped = stream(1000, 0, 0);
  stopped.mode = "reflex";
  stopped.errors = "joint_reflex";
  const struct {
    const char* what;
    ArmStreamReading reading;
    Judgment version_real, stream_real, stream_simulated;
  } rows[] = {{"regular", stream(1000, 0, 0), ok, ok, ok},
              {"in reflex", stopped, warning, ok, ok},
              {"a few late", stream(1000, 0, 20), ok, warning, warning},
              {"many late", stream(1000, 0, 100), ok, bad, warning},
              {"one lost", stream(999, 1, 0), ok, warning, warning},
              {"a hole", stream(975, 25, 0), ok, bad, warning},
              {"slow", stream(300, 0, 0), ok, bad, unknown},
              {"silent", silent, ok, bad, bad},
              {"unreachable", unreachable, bad, unknown, unknown}};
  for (const auto& row : rows) {
    EXPECT_EQ(judge_arm_version(row.reading, kReal).judged, row.version_real) << row.what;
    EXPECT_EQ(judge_state_stream(row.reading, kReal).judged, row.stream_real) << row.what;
    EXPECT_EQ(judge_state_stream(row.reading, kSimulated).judged, row.stream_simulated) << row.what;
  }
}

TEST(DoctorJudges, MeasuredValuesAreInTheMessages) {
  EXPECT_THAT(judge_load(load({1.0, 0.9}), kReal).cure, HasSubstr("hungry (process 42)"));
  EXPECT_THAT(judge_idle_states(governed({}, 133), kReal).measured, HasSubstr("C6 wakes within 133 us"));
  EXPECT_THAT(judge_timer(timer(0, 25, 21), kReal).cause, HasSubstr("21 in a row"));
  EXPECT_THAT(judge_round_trip(trip(20, 0), kReal).measured, HasSubstr("p99 350"));
  EXPECT_THAT(judge_dds(DdsReading{.domains = {}}, kReal).measured, HasSubstr("ROS 2 is not running"));
}

TEST(DoctorBlames, WhatIsLateOnly) {
  const Finding bad_kernel = judge_kernel({"6.1", "#1 SMP", {}}, kReal);
  const Finding late = judge_timer(timer(100), kReal), on_time = judge_timer(timer(0), kReal);
  const Finding slow = judge_round_trip(trip(100, 0), kReal);
  EXPECT_TRUE(blame({bad_kernel, on_time}).empty());
  ASSERT_EQ(blame({bad_kernel, late}).size(), 1u);
  EXPECT_THAT(blame({bad_kernel, late})[0], HasSubstr("PREEMPT_RT"));
  EXPECT_THAT(blame({late})[0], HasSubstr("firmware"));
  ASSERT_EQ(blame({bad_kernel, on_time, slow}).size(), 1u);
  EXPECT_THAT(blame({bad_kernel, on_time, slow})[0], HasSubstr("the cause is the network"));
  EXPECT_THAT(blame({late, slow})[1], HasSubstr("fix the computer first"));
  EXPECT_THAT(blame({judge_control_cycle(cycle(900, 1200), kReal)})[0], HasSubstr("controllers"));
  EXPECT_THAT(blame({judge_control_cycle(cycle(20, 2000), kReal)})[0], HasSubstr("interrupt"));
}

TEST(DoctorShows, EveryFindingAsTextAndJson) {
  Finding finding = judge_timer(timer(100), kReal);
  finding.figures.push_back({"none", std::numeric_limits<double>::quiet_NaN(), ""});
  const auto lines = to_text(finding, false);
  EXPECT_THAT(lines.front(), testing::StartsWith("bad      timer wake-up at 1 kHz"));
  EXPECT_THAT(testing::PrintToString(lines), HasSubstr("cause: "));
  EXPECT_THAT(testing::PrintToString(lines), HasSubstr("cure:  "));
  for (const auto& line : lines) EXPECT_LE(line.size(), 130u) << line;
  const auto json = nlohmann::json::parse(to_json({finding}, kReal, 10));
  EXPECT_EQ(json["verdict"], "bad");
  EXPECT_EQ(json["purpose"], "real_arms");
  const auto& one = json["findings"][0];
  EXPECT_EQ(one["figures"]["p999"]["value"], 400);
  EXPECT_EQ(one["figures"]["p999"]["unit"], "us");
  EXPECT_TRUE(one["figures"]["none"]["value"].is_null());
  EXPECT_EQ(one["histogram"].size(), distribution_of(timer(100).late_us).bars.size());
}

}  // namespace
}  // namespace multipanda::doctor::judgments_test

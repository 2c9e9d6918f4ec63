// Readers of synthetic system files and of this computer; percentiles and histograms.
#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <random>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "doctor/computer.hpp"
#include "doctor/examination.hpp"
#include "doctor/finding.hpp"

namespace multipanda::doctor::readers_test {
namespace {

constexpr auto kReal = Purpose::real_arms;
constexpr auto kSimulated = Purpose::simulated_arms;

TEST(DoctorDistribution, AgreesWithCountingByHand) {
  std::mt19937 random(7);
  std::exponential_distribution<double> draw(1.0 / 40);
  std::vector<double> us(2347);
  for (double& value : us) value = draw(random);
  us[100] = 20000;
  const Distribution result = distribution_of(us);
  EXPECT_EQ(result.count, us.size());
  EXPECT_EQ(result.worst, 20000);
  const auto not_above = [&](double value) {
    return static_cast<double>(std::count_if(us.begin(), us.end(), [&](double v) { return v <= value; })) /
           static_cast<double>(us.size());
  };
  for (const auto& [value, share] : {std::pair(result.p50, 0.5), {result.p99, 0.99}, {result.p999, 0.999}}) {
    EXPECT_GE(not_above(value), share);
    EXPECT_LT(not_above(std::nextafter(value, 0)), share);  // the smallest such value
  }
  std::size_t total = 0;
  for (const auto& bar : result.bars) {
    total += bar.count;
    EXPECT_EQ(bar.count, static_cast<std::size_t>(std::count_if(
                             us.begin(), us.end(), [&](double v) { return v >= bar.from && v < bar.to; })));
  }
  EXPECT_EQ(total, us.size());
  EXPECT_EQ(distribution_of({}).count, 0u);
  EXPECT_DOUBLE_EQ(share_above({1, 2, 3, 4}, 2), 0.5);
}

class MadeUpSystem : public testing::Test {
 protected:
  MadeUpSystem() {
    std::string name = (std::filesystem::temp_directory_path() / "multipanda_doctor_XXXXXX").string();
    root_ = mkdtemp(name.data());
  }
  ~MadeUpSystem() override { std::filesystem::remove_all(root_); }
  void put(const std::string& file, const std::string& text) {
    std::filesystem::create_directories((root_ / file).parent_path());
    std::ofstream(root_ / file) << text;
  }
  SystemFiles files() const { return SystemFiles(root_); }
  std::filesystem::path root_;
};

TEST_F(MadeUpSystem, MissingFilesGiveUnknownAndNoCrash) {
  EXPECT_EQ(judge_governor(read_processor(files()), kReal).judged, Judgment::unknown);
  EXPECT_EQ(judge_idle_states(read_processor(files()), kReal).judged, Judgment::unknown);
  EXPECT_EQ(judge_throttling(read_scheduling(files()), kReal).judged, Judgment::unknown);
  EXPECT_EQ(judge_virtual_machine(read_machine_kind(files()), kReal).judged, Judgment::unknown);
  const LoadSample nothing = sample_load(files());
  const LoadReading reading = load_between(nothing, nothing, files());
  EXPECT_EQ(judge_load(reading, kReal).judged, Judgment::unknown);
  EXPECT_EQ(judge_steal(reading, kReal).judged, Judgment::unknown);
  EXPECT_EQ(judge_dds(read_dds(nothing, nothing, files()), kReal).judged, Judgment::ok);
  EXPECT_FALSE(read_kernel(files()).realtime_flag);
}

TEST_F(MadeUpSystem, ProcessorAsReportedByTheKernel) {
  for (const auto& [core, khz] : {std::pair("cpu0", "800000\n"), std::pair("cpu1", "3200000\n")}) {
    const std::string folder = std::string("sys/devices/system/cpu/") + core + "/cpufreq/";
    put(folder + "scaling_governor", "powersave\n");
    put(folder + "scaling_cur_freq", khz);
    put(folder + "cpuinfo_max_freq", "4200000\n");
  }
  put("sys/devices/system/cpu/cpufreq/boost", "0\n");
  put("sys/devices/system/cpu/intel_pstate/no_turbo", "0\n");
  put("sys/devices/system/cpu/cpu0/cpuidle/state1/name", "C6\n");
  put("sys/devices/system/cpu/cpu0/cpuidle/state1/latency", "133\n");
  put("sys/devices/system/cpu/cpu0/cpuidle/state1/disable", "1\n");
  put("sys/kernel/realtime", "1\n");
  const ProcessorReading reading = read_processor(files());
  EXPECT_EQ(reading.governors, (std::map<std::string, int>{{"powersave", 2}}));
  EXPECT_EQ(reading.slowest_mhz, 800);
  EXPECT_EQ(reading.fastest_mhz, 3200);
  EXPECT_EQ(reading.max_mhz, 4200);
  EXPECT_EQ(reading.turbo, true);
  ASSERT_EQ(reading.idle_states.size(), 1u);
  EXPECT_FALSE(reading.idle_states[0].enabled);
  EXPECT_EQ(read_kernel(files()).realtime_flag, 1);
}

TEST_F(MadeUpSystem, LoadFromTwoSamples) {
  // Ticks: user nice system idle iowait irq softirq steal. Core 0: 60 of 100 busy, 10 stolen; core 1 idle.
  put("proc/stat", "cpu  0 0 0 0\ncpu0 0 0 0 0 0 0 0 0 0 0\ncpu1 5 0 0 5 0 0 0 0 0 0\nctxt 1\n");
  put("proc/17/stat", "17 (a (b) c) S 1 1 1 0 -1 0 0 0 0 0 10 5 0 0 20 0\n");
  put("proc/net/netstat", "TcpExt: A\nTcpExt: 1\nIpExt: X InMcastPkts OutMcastPkts Y\nIpExt: 9 100 10 9\n");
  LoadSample before = sample_load(files());
  put("proc/stat", "cpu  0 0 0 0\ncpu0 40 5 10 20 10 2 3 10 0 0\ncpu1 5 0 0 105 0 0 0 0 0 0\nctxt 1\n");
  put("proc/17/stat", "17 (a (b) c) S 1 1 1 0 -1 0 0 0 0 0 40 15 0 0 20 0\n");
  put("proc/18/stat", "18 (new) S 1 1 1 0 -1 0 0 0 0 0 2 1 0 0 20 0\n");
  put("proc/19/stat", "broken");
  put("proc/net/netstat", "IpExt: X InMcastPkts OutMcastPkts Y\nIpExt: 9 300 60 9\n");
  put("sys/devices/system/cpu/isolated", "2-3,6\n");
  put("proc/net/udp",
      "  sl  local_address\n 1: 00000000:1CE8 00000000:0000 07\n 2: 00000000:1CF2 00000000:0000 07\n"
      " 3: 00000000:1DE2 0\n");
  LoadSample after = sample_load(files());
  before.time_s = 10;
  after.time_s = 12;
  const LoadReading reading = load_between(before, after, files());
  EXPECT_THAT(reading.cores, testing::ElementsAre(testing::DoubleEq(0.6), testing::DoubleEq(0)));
  EXPECT_DOUBLE_EQ(reading.steal.value(), 0.05);
  ASSERT_EQ(reading.processes.size(), 2u);
  EXPECT_EQ(reading.processes[0].name, "a (b) c");
  EXPECT_DOUBLE_EQ(reading.processes[0].cores, 0.4);
  EXPECT_DOUBLE_EQ(reading.processes[1].cores, 0.03);
  EXPECT_THAT(reading.isolated, testing::ElementsAre(2, 3, 6));
  const DdsReading dds = read_dds(before, after, files());
  EXPECT_THAT(dds.domains, testing::ElementsAre(0, 1));
  EXPECT_DOUBLE_EQ(dds.multicast_in.value(), 100);
  EXPECT_DOUBLE_EQ(dds.multicast_out.value(), 25);
}

TEST(DoctorReaders, ControlCycleFromItsProgram) {
  const auto reading = parse_control_cycle(
      R"({"scene":"s","cycles":5,"p50_us":1.5,"p99_us":2,"p999_us":3,"worst_us":4,"guarded":true,
          "memory_locked":false,"heap_calls":6,"lock_calls":7,"page_faults":8,"interruptions":9})");
  EXPECT_EQ(reading.p50, 1.5);
  EXPECT_EQ(reading.lock_calls, 7u);
  EXPECT_EQ(parse_control_cycle(R"({"scene":"s","reason":"no such scene"})").reason, "no such scene");
  for (const char* text : {"", "{}", "[1]", R"({"scene":"s","cycles":"many"})"})
    EXPECT_THROW((void)parse_control_cycle(text), std::runtime_error) << text;
}

TEST(DoctorReaders, ThisComputerToItself) {
  const NetworkCardReading self = read_network_card("127.0.0.2", SystemFiles());
  EXPECT_TRUE(self.loopback) << self.reason;
  const RoundTripReading there = read_round_trip("127.0.0.1", 0.05);
  EXPECT_FALSE(there.us.empty()) << there.reason;  // by echo, or by a refused connection
  EXPECT_LE(there.us.size(), there.sent);
  EXPECT_GT(*std::min_element(there.us.begin(), there.us.end()), 0);
  const NetworkCardReading nowhere = read_network_card("no.such.name.invalid", SystemFiles());
  EXPECT_TRUE(nowhere.interface.empty());
  EXPECT_FALSE(nowhere.reason.empty());
  EXPECT_EQ(purpose_of({"127.0.0.1", "localhost"}), kSimulated);
  EXPECT_EQ(purpose_of({"127.0.0.1", "172.16.0.2"}), kReal);
  const TimerReading timer = read_timer(0.05);
  EXPECT_GE(timer.late_us.size() + timer.missed, 50u);
}

}  // namespace
}  // namespace multipanda::doctor::readers_test

// Logs of the last 30 s: what they contain, when they are written, and what happens if they cannot be.
#include "runtime/kept_logs.hpp"

#include <bit>
#include <csignal>
#include <cstring>
#include <fstream>
#include <random>
#include <sys/resource.h>

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <nlohmann/json.hpp>

#include "core/record/arm_config.hpp"
#include "logs/mcap_reader.hpp"
#include "logs/messages.hpp"
#include "logs/testing/test_files.hpp"
#include "runtime/faulty.hpp"
#include "runtime/live_input/client.hpp"
#include "runtime/session.hpp"
#include "scene/load.hpp"

namespace multipanda::kept_logs_test {
namespace {

using testing::ElementsAre;
using testing::HasSubstr;
using testing::IsEmpty;
using testing::SizeIs;

// All messages: topic, time and bytes.
std::vector<std::tuple<std::string, std::int64_t, std::string>> messages(const std::filesystem::path& log) {
  std::vector<std::tuple<std::string, std::int64_t, std::string>> all;
  McapReader reader(log);
  while (const auto message = reader.next())
    all.emplace_back(message->channel->topic, message->log_time_ns,
                     std::string(message->data.begin(), message->data.end()));
  EXPECT_TRUE(reader.complete());
  return all;
}

std::vector<std::uint64_t> cycles(const std::filesystem::path& log) {
  std::vector<std::uint64_t> all;
  McapReader reader(log);
  while (const auto message = reader.next())
    if (message->channel->topic == "/timing") all.push_back(from_cdr<msg::CycleTiming>(message->data).cycle);
  return all;
}

RecordLayout layout() {
  RecordLayout layout;
  layout.arms = {{"left", 7}, {"right", 6}};
  layout.instances = {{.name = "law",
                       .type = "cartesian_impedance",
                       .arms = 3,
                       .inputs = {{"pose", "pose", "world"}, {"force", "wrench", "world"}},
                       .parameters = {"stiffness"},
                       .features = {},
                       .outputs = {{"error_m", 0, 3}, {"force_n", 3, 2}}}};
  layout.output_count = 5;
  layout.max_references = 2;
  return layout;
}

Event configuration(std::uint64_t cycle, double mass) {
  Event event;
  put_arm_config(event, {}, {.mass = mass}, {});
  event.arm = 0;
  event.cycle = cycle;
  event.t.ns = static_cast<std::int64_t>(cycle) * 1'000'000;
  return event;
}

// A record of other numbers, also those that are none.
void change(CycleRecord& record, std::mt19937_64& random) {
  const auto any = [&] { return std::bit_cast<double>(random()); };
  record.t.ns = static_cast<std::int64_t>(++record.cycle) * 1'000'000;
  record.start.ns += 999'000 + static_cast<std::int64_t>(random() % 3000);
  record.period_s = 1e-9 * static_cast<double>(random() % 2'000'000);
  record.overruns += random() % 2;
  record.stages.total = static_cast<std::int32_t>(random() % 50'000);
  for (ArmSample& arm : record.arms) {
    ++arm.sequence;
    arm.has_wrench_estimate = arm.has_report = true;
    arm.q[random() % 7] = any();
    arm.F_K_W_est[random() % 6] = any();
  }
  record.outputs[random() % 5] = any();
  record.reference_count = random() % 3;
  for (std::size_t i = 0; i < record.reference_count; ++i) {
    record.references[i].input = static_cast<std::uint8_t>(i);
    record.references[i].size = static_cast<std::uint8_t>(i == 0 ? 7 : 6);
    record.references[i].values[random() % 7] = any();
  }
}

class KeptLogsTest : public testing::Test {
 protected:
  std::unique_ptr<KeptLogs> make(const std::filesystem::path& folder, const char* every = "timing=1") {
    RecorderOptions options;
    if (std::string(every) == "timing=1") options.every.set("all=0");
    options.every.set(every);
    return std::make_unique<KeptLogs>(KeptLogs::Parts{.layout = layout(),
                                                      .arms = std::vector<RecordedArm>(2),
                                                      .options = [options] { return options; },
                                                      .folder = [folder] { return folder; },
                                                      .report =
                                                          [this](const std::string& text) {
                                                            const std::lock_guard lock(mutex_);
                                                            said_.push_back(text);
                                                          }});
  }
  void run(KeptLogs& kept, double until_s) {
    while (record_.t.seconds() < until_s) {
      change(record_, random_);
      kept.take(record_);
    }
  }
  std::filesystem::path kept_now(KeptLogs& kept) {
    auto [log, answer] = kept.keep();
    const RequestAnswer result = answer.get();
    EXPECT_TRUE(result.success) << result.reason;
    return log;
  }

  const TestFolder folder_;
  std::mt19937_64 random_{1};
  CycleRecord record_{2, 2, 5};
  std::mutex mutex_;
  std::vector<std::string> said_;
};

TEST_F(KeptLogsTest, AreTheLogOfARecorderToTheByte) {
  RecordRing ring(layout(), 64);
  Recorder recorder(folder_ / "whole.mcap", layout(), ring, std::vector<RecordedArm>(2), {});
  const auto kept = make(folder_.path(), "state=1");
  for (int k = 0; k < 5000; ++k) {
    change(record_, random_);
    if (k % 500 == 0) {
      const Event event = configuration(record_.cycle, k);
      kept->take(event);
      EXPECT_TRUE(ring.events.push(event));
      const EpisodeMark mark{.episode = record_.cycle, .cycle = record_.cycle - 1, .t = record_.t};
      kept->take(mark);
      recorder.mark(mark);
    }
    kept->take(record_);
    while (!ring.ring.push(record_)) std::this_thread::yield();
  }
  EXPECT_THAT(recorder.stop().missing(), IsEmpty());
  EXPECT_TRUE(messages(kept_now(*kept)) == messages(folder_ / "whole.mcap"));
}

std::size_t resident_bytes() {
  std::size_t pages = 0;
  std::ifstream("/proc/self/statm") >> pages >> pages;
  return pages * 4096;
}

TEST_F(KeptLogsTest, HaveTheNewestWithWhatWasInForceAndTakeNoMemoryOfTheProgram) {
  const auto kept = make(folder_.path());
  kept->take(configuration(1, 0.5));
  kept->take(configuration(1, 1.5));
  run(*kept, 1);
  const std::size_t before = resident_bytes();
  run(*kept, 100);  // 64 MB of samples of arms
  EXPECT_LT(resident_bytes(), before + (4u << 20));
  const auto log = kept_now(*kept);
  const auto found = cycles(log);
  EXPECT_EQ(found.back(), 100'000u);
  EXPECT_GE(found.size(), 32'000u);
  EXPECT_LE(found.size(), 33'100u);
  EXPECT_EQ(found.back() - found.front() + 1, found.size());
  McapReader reader(log);
  auto message = reader.next();
  while (message && message->channel->topic != "/left/config") message = reader.next();
  ASSERT_TRUE(message);
  EXPECT_EQ(from_cdr<msg::ArmConfig>(message->data).tool_mass, 1.5);
  EXPECT_EQ(from_cdr<msg::ArmConfig>(message->data).cycle, found.front());
}

TEST_F(KeptLogsTest, FaultsInARowHaveOnePerThirtySecondsWithoutAGap) {
  const auto kept = make(folder_.path());
  run(*kept, 40);
  for (double t = 40; t < 100; t += 0.5) {
    kept->fault();
    run(*kept, t + 0.5);
  }
  const auto logs = kept->finish();
  ASSERT_THAT(logs, SizeIs(3));  // due at 42 s, 72 s and the end
  std::uint64_t until = 10'001;
  for (const auto& log : logs) {
    const auto found = cycles(log);
    ASSERT_FALSE(found.empty());
    EXPECT_LE(found.front(), until);
    EXPECT_EQ(found.back() - found.front() + 1, found.size());
    until = found.back();
  }
  EXPECT_EQ(until, 100'000u);
  EXPECT_THAT(said_, SizeIs(3));
}

TEST_F(KeptLogsTest, AreBoundedInNumber) {
  const auto kept = make(folder_.path());
  EXPECT_THAT(kept->keep().second.get().reason, HasSubstr("nothing has happened yet"));
  run(*kept, 0.1);
  for (std::size_t i = 0; i < KeptLogs::kMost; ++i) (void)kept_now(*kept);
  said_.clear();
  auto [log, answer] = kept->keep();
  EXPECT_TRUE(log.empty());
  EXPECT_THAT(answer.get().reason, HasSubstr("has written 10 logs, see " + folder_.path().string()));
  kept->fault();
  EXPECT_THAT(kept->finish(), SizeIs(KeptLogs::kMost));
  EXPECT_THAT(said_, ElementsAre(HasSubstr("has written 10 logs")));
}

// Records are kept as changes of those before.
TEST_F(KeptLogsTest, WithoutMemoryHaveAGapAndWholeRecordsBesideIt) {
  const auto kept = make(folder_.path(), "state=1");
  std::vector<JointArray> q(1);  // by cycle
  const auto run_with = [&](rlim_t largest_file, double until_s) {
    rlimit limit{};
    (void)getrlimit(RLIMIT_FSIZE, &limit);
    limit.rlim_cur = largest_file;
    ASSERT_EQ(setrlimit(RLIMIT_FSIZE, &limit), 0);
    while (record_.t.seconds() < until_s) {
      change(record_, random_);
      q.push_back(record_.arms[0].q);
      kept->take(record_);
    }
  };
  const auto handler = std::signal(SIGXFSZ, SIG_IGN);
  run_with(RLIM_INFINITY, 1.5);
  run_with(100'000, 1.8);
  run_with(RLIM_INFINITY, 4);
  std::signal(SIGXFSZ, handler);
  McapReader reader(kept_now(*kept));
  std::size_t found = 0;
  while (const auto message = reader.next()) {
    if (message->channel->topic != "/left/state") continue;
    const auto state = from_cdr<msg::ArmState>(message->data);
    ASSERT_EQ(std::memcmp(state.q.data(), q[state.cycle].data(), 7 * sizeof(double)), 0) << state.cycle;
    ++found;
  }
  EXPECT_GE(found, 2000u);
  EXPECT_LT(found, 4000u);
}

TEST_F(KeptLogsTest, AFullDiskOrAFolderThatTakesNoneIsAMessage) {
  std::filesystem::create_symlink("/dev/full", folder_ / "last_30_s_1.mcap");
  for (const auto& [folder, text] :
       {std::pair<std::filesystem::path, const char*>{folder_.path(), "No space left on device"},
        {"/proc", "cannot create the log"},
        {"", "no folder"}}) {
    said_.clear();
    record_.t = {};
    const auto kept = make(folder);
    run(*kept, 1);
    kept->fault();
    run(*kept, 4);
    EXPECT_THAT(kept->finish(), IsEmpty());
    EXPECT_THAT(said_, ElementsAre(HasSubstr(text)));
  }
}

// --- In a run ---

Scene faulty_scene(const Registry& registry) {
  return parse_scene(
      "arms:\n  - {name: left}\ncontrollets:\n  - {name: bad, type: faulty, arms: left, parameters: "
      "{after_s: 0.2}}\nactive: [bad]\nduration_s: 0.5\n",
      "faulty.yaml", registry);
}

class KeptInARun : public testing::Test {
 protected:
  KeptInARun() { registry_.add(faulty_controllet()); }
  Registry registry_ = Registry::with_builtins();
  const TestFolder folder_;
};

TEST_F(KeptInARun, AFaultLeavesALogAndARequestToo) {
  Session session(faulty_scene(registry_), registry_, {.socket = folder_ / "run.sock"});
  LiveClient client(folder_ / "run.sock");
  EXPECT_THAT(client.ask({{"do", "keep"}}, 60).value("reason", ""), HasSubstr("nothing has happened yet"));
  session.start();
  while (session.status().cycles == 0 && !session.wait_for_end(0.001)) {
  }
  const auto answer = client.ask({{"do", "keep"}}, 60);
  const RunSummary summary = session.finish();
  ASSERT_THAT(summary.kept, SizeIs(2));
  EXPECT_EQ(answer.value("log", ""), summary.kept[0].string()) << answer;
  for (const auto& log : summary.kept) {
    const auto found = cycles(log);
    ASSERT_FALSE(found.empty());
    EXPECT_EQ(found.front(), 1u);
    EXPECT_EQ(found.back(), found.size());  // without a gap
  }
  EXPECT_EQ(cycles(summary.kept[1]).size(), summary.cycles);
  std::filesystem::remove_all(summary.kept[0].parent_path());
}

TEST_F(KeptInARun, ARecordedRunAnswersWithItsLogAndOthersRefuse) {
  Session recorded(faulty_scene(registry_), registry_, {.record = folder_.path()});
  auto [log, answer] = recorded.keep();
  EXPECT_TRUE(answer.get().success);
  EXPECT_EQ(log, recorded.directory() / "log.mcap");
  for (const bool paced : {false, true}) {
    Session session(faulty_scene(registry_), registry_, {.paced = paced, .keep_last = false});
    const RequestAnswer refused = session.keep().second.get();
    EXPECT_FALSE(refused.success);
    EXPECT_THAT(refused.reason, HasSubstr("--keep-nothing"));
  }
}

}  // namespace
}  // namespace multipanda::kept_logs_test

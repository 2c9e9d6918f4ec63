#include "runtime/shared_records/shared_records.hpp"

#include <atomic>
#include <cmath>
#include <map>
#include <random>
#include <sys/mman.h>
#include <thread>

#include <gtest/gtest.h>
#include <nlohmann/json.hpp>

#include "core/testing/drawn_sample.hpp"
#include "core/testing/test_world.hpp"

namespace multipanda::shared_records_test {
namespace {

using nlohmann::json;

// Reads the memory as another program would: from the descriptor and the text in it, nothing else.
class Reader {
 public:
  explicit Reader(int file) {
    const auto bytes = static_cast<std::size_t>(lseek(file, 0, SEEK_END));
    data_ = static_cast<const char*>(mmap(nullptr, bytes, PROT_READ, MAP_SHARED, file, 0));
    table = json::parse(std::string(data_ + 96, count(8)));
    for (const auto& field : table["fields"]) fields_[field[0]] = field;
  }
  std::uint64_t count(std::size_t at) const { return value<std::uint64_t>(at); }
  std::uint64_t records() const { return count(64); }
  std::string magic() const { return {data_, 8}; }
  std::size_t slot(std::uint64_t number) const {
    return table["first_record"].get<std::size_t>() +
           number % table["records"].get<std::size_t>() * table["record_bytes"].get<std::size_t>();
  }
  template <class T>
  T value(std::size_t at) const {
    T out;
    std::memcpy(&out, data_ + at, sizeof(T));
    return out;
  }
  std::size_t offset(const std::string& name) const { return fields_.at(name)[2]; }
  std::size_t size(const std::string& name) const { return fields_.at(name)[3]; }
  std::string type(const std::string& name) const { return fields_.at(name)[1]; }
  bool has(const std::string& name) const { return fields_.count(name) != 0; }
  double number(std::uint64_t record, const std::string& name, std::size_t k = 0) const {
    EXPECT_EQ(type(name), "f8");
    return value<double>(slot(record) + offset(name) + 8 * k);
  }
  std::uint64_t integer(std::uint64_t record, const std::string& name) const {
    EXPECT_NE(type(name), "f8");
    return value<std::uint64_t>(slot(record) + offset(name));
  }
  double any(std::uint64_t record, const std::string& name, std::size_t k) const {
    const std::size_t at = slot(record) + offset(name) + 8 * k;
    return type(name) == "f8" ? value<double>(at) : static_cast<double>(value<std::int64_t>(at));
  }
  std::string event(std::uint64_t number) const {
    const std::size_t at =
        table["first_event"].get<std::size_t>() +
        number % table["events"].get<std::size_t>() * table["event_bytes"].get<std::size_t>();
    EXPECT_EQ(count(at), 2 * number + 2);
    return {data_ + at + 32, count(at + 24)};
  }
  json table;

 private:
  const char* data_ = nullptr;
  std::map<std::string, json> fields_;
};

struct Fixture {
  static InstanceConfig config(std::string name, std::string type, std::vector<ArmIndex> arms) {
    InstanceConfig config;
    config.name = std::move(name);
    config.type = std::move(type);
    config.arms = std::move(arms);
    return config;
  }
  Fixture()
      : loop(2, {config("pose0", "cartesian_impedance", {0}), config("joint1", "joint_impedance", {1})},
             Registry::with_builtins(), 16),
        shared("fixture", loop.cycle.layout(), loop.models, {ArmFrames{}, ArmFrames{}}),
        reader(shared.memory().file()) {}

  // One cycle, and its record as the loop made it.
  CycleRecord step(ArmSet stopped = {}) {
    loop.step();
    RecordRing& ring = *loop.cycle.record();
    for (; const Event* event = ring.events.front(); ring.events.pop()) shared.take(*event);
    CycleRecord record = *ring.ring.front();
    ring.ring.pop();
    shared.take(record, stopped);
    return record;
  }

  test::TestLoop loop;
  SharedRecords shared;
  Reader reader;
};

TEST(SharedRecordsTest, TheTableDescribesTheMemory) {
  Fixture fixture;
  const Reader& reader = fixture.reader;
  EXPECT_EQ(reader.magic(), "mp-rec-1");
  EXPECT_EQ(reader.count(24), fixture.shared.memory().size());
  std::uint64_t hash = 0xcbf29ce484222325u;  // FNV-1a
  for (const char c : fixture.shared.table()) {
    hash ^= static_cast<unsigned char>(c);
    hash *= 1099511628211u;
  }
  EXPECT_EQ(reader.count(16), hash);
  EXPECT_EQ(std::stoull(fixture.shared.hash(), nullptr, 16), hash);
  // Fields follow each other without gaps, and the rings fit into the memory.
  std::size_t at = 8;
  for (const auto& field : reader.table["fields"]) {
    EXPECT_EQ(field[2], at) << field;
    at += 8 * field[3].get<std::size_t>();
  }
  EXPECT_EQ(reader.table["record_bytes"], at);
  EXPECT_LE(reader.slot(0) + reader.table["records"].get<std::size_t>() * at, reader.table["first_event"]);
  EXPECT_EQ(
      reader.table["first_event"].get<std::size_t>() + SharedRecords::kEvents * SharedRecords::kEventBytes,
      reader.count(24));
  EXPECT_LE(96 + reader.count(8), reader.slot(0));
  EXPECT_GE(SharedRecords::kRecords * kArmPeriod, 2.0);  // [s]
}

TEST(SharedRecordsTest, EveryNumberOfARecordIsThere) {
  Fixture fixture;
  ASSERT_TRUE(fixture.loop.activate({"pose0"}).accepted());
  (void)fixture.loop.cycle.record()->ring.front();
  fixture.loop.cycle.record()->ring.pop();  // of activate()
  for (int i = 0; i < 5; ++i) (void)fixture.step();
  const CycleRecord record = fixture.step(ArmSet::of(1));
  const Reader& reader = fixture.reader;
  ASSERT_EQ(reader.records(), 6u);
  EXPECT_EQ(reader.count(reader.slot(5)), 12u);
  EXPECT_EQ(reader.integer(5, "cycle"), record.cycle);
  EXPECT_EQ(reader.integer(5, "t_ns"), static_cast<std::uint64_t>(record.t.ns));
  EXPECT_EQ(reader.integer(5, "start_ns"), static_cast<std::uint64_t>(record.start.ns));
  EXPECT_EQ(reader.integer(5, "total_ns"), static_cast<std::uint64_t>(record.stages.total));
  for (std::size_t a = 0; a < 2; ++a) {
    const std::string arm = fixture.loop.cycle.layout().arms[a].name + "/";
    const ArmSample& sample = record.arms[a];
    const std::map<std::string, const JointArray*> joints{{"q_rad", &sample.q},
                                                          {"dq_rad_per_s", &sample.dq},
                                                          {"tau_J_nm", &sample.tau_J},
                                                          {"tau_J_d_nm", &sample.tau_J_d},
                                                          {"tau_cmd_nm", &sample.tau_cmd},
                                                          {"tau_controllet_nm", &sample.tau_controllet}};
    for (const auto& [name, values] : joints) {
      ASSERT_EQ(reader.size(arm + name), 7u);
      for (std::size_t j = 0; j < 7; ++j)
        EXPECT_EQ(reader.number(5, arm + name, j), (*values)[j]) << arm << name;
    }
    EXPECT_EQ(reader.integer(5, arm + "owner"), sample.owner);
    EXPECT_EQ(reader.integer(5, arm + "mode"), sample.mode);
    EXPECT_EQ(reader.integer(5, arm + "stopped"), a == 1 ? 1u : 0u);
    EXPECT_EQ(reader.integer(5, arm + "sequence"), sample.sequence);
    EXPECT_EQ(std::isnan(reader.number(5, arm + "wrench_n_nm")), !sample.has_wrench_estimate);
    // The pose as the loop's own model has it.
    ModelTerms terms(fixture.loop.models[a]);
    terms.update(JointVector(Eigen::Map<const Eigen::VectorXd>(sample.q.data(), 7)), JointVector::Zero(7));
    for (int k = 0; k < 3; ++k)
      EXPECT_DOUBLE_EQ(reader.number(5, arm + "position_m", static_cast<std::size_t>(k)),
                       terms.X_WF().position[k]);
  }
  ASSERT_EQ(record.reference_count, 1u);
  ASSERT_EQ(reader.size("pose0/pose"), 7u);
  for (std::size_t k = 0; k < 7; ++k)
    EXPECT_EQ(reader.number(5, "pose0/pose", k), record.references[0].values[k]);
  for (const auto& instance : fixture.loop.cycle.layout().instances) {
    for (const auto& output : instance.outputs) {
      const std::string name = instance.name + "/outputs/" + output.name;
      for (std::size_t k = 0; k < output.size; ++k) {
        const double expected = record.outputs[output.offset + k];
        const double found = reader.number(5, name, k);
        EXPECT_TRUE(found == expected || (std::isnan(found) && std::isnan(expected))) << name;
      }
    }
  }
}

// By the walk over the table of core/state/arm_sample.hpp.
TEST(SharedRecordsTest, EveryQuantityOfAnArmIsThereAndKnownOrNot) {
  Fixture fixture;
  CycleRecord record = fixture.step();
  std::mt19937_64 random(5);
  for (std::uint64_t n = 1; n < 3; ++n) {
    std::vector<test::DrawnSample> drawn;
    for (ArmSample& arm : record.arms) arm = drawn.emplace_back(test::draw_sample(random, 7, n == 1)).sample;
    fixture.shared.take(record, {});
    const Reader& reader = fixture.reader;
    for (std::size_t a = 0; a < 2; ++a) {
      const std::string arm = fixture.loop.cycle.layout().arms[a].name + "/";
      for (const auto& [name, expected] : drawn[a].numbers) {
        ASSERT_EQ(reader.size(arm + name), expected.size()) << name;
        const std::string known = drawn[a].known.at(name);
        EXPECT_EQ(reader.table["known_by"].value(name, "always"), known);
        for (std::size_t k = 0; k < expected.size(); ++k) {
          const double found = reader.any(n, arm + name, k);
          if (std::isnan(found)) {
            EXPECT_TRUE(n == 2 && known != "always") << name;
          } else {
            EXPECT_NEAR(found, expected[k], 1e-14) << name;
          }
        }
      }
    }
  }
}

TEST(SharedRecordsTest, ReferencesOfInactiveControlletsAreNotNumbers) {
  Fixture fixture;
  (void)fixture.step();
  EXPECT_TRUE(std::isnan(fixture.reader.number(0, "pose0/pose", 0)));
  EXPECT_TRUE(std::isnan(fixture.reader.number(0, "pose0/pose", 6)));
}

TEST(SharedRecordsTest, FramesChangeThePoseFromTheirRecordOn) {
  Fixture fixture;
  const CycleRecord record = fixture.step();
  Event config{.kind = EventKind::arm_config, .arm = 0};
  config.size = 34;
  config.values = {0, 0, 0.25, 1, 0, 0, 0, 0, 0, 0, 1};
  fixture.shared.take(config);
  fixture.shared.take(record, {});
  const std::string name = fixture.loop.cycle.layout().arms[0].name + "/position_m";
  double square = 0;
  for (std::size_t k = 0; k < 3; ++k) {
    const double moved = fixture.reader.number(1, name, k) - fixture.reader.number(0, name, k);
    square += moved * moved;
  }
  EXPECT_NEAR(std::sqrt(square), 0.25, 1e-12);
}

TEST(SharedRecordsTest, OldRecordsAreOverwrittenAndTellSo) {
  Fixture fixture;
  CycleRecord record = fixture.step();
  for (std::size_t n = 1; n < SharedRecords::kRecords + 10; ++n) {
    record.cycle = 1000 + n;
    fixture.shared.take(record, {});
  }
  const Reader& reader = fixture.reader;
  EXPECT_EQ(reader.records(), SharedRecords::kRecords + 10);
  EXPECT_EQ(reader.count(reader.slot(3)), 2 * (SharedRecords::kRecords + 3) + 2);  // not number 3 any more
  EXPECT_EQ(reader.count(reader.slot(10)), 2u * 10 + 2);
  EXPECT_EQ(reader.integer(10, "cycle"), 1010u);
}

// A reader that copies what is being written must notice it by the numbers around its copy.
TEST(SharedRecordsTest, ACopyIsWholeOrKnownToBeTorn) {
  Fixture fixture;
  CycleRecord record = fixture.step();
  std::atomic<bool> end{false};
  std::uint64_t whole = 0, overtaken = 0;
  std::jthread reading([&] {
    const Reader& reader = fixture.reader;
    const std::string first = fixture.loop.cycle.layout().arms[0].name + "/q_rad";
    const std::string last = fixture.loop.cycle.layout().arms[1].name + "/tau_cmd_nm";
    const std::size_t at_first = reader.offset(first), at_last = reader.offset(last);
    while (!end.load()) {
      // The oldest record, which the writer is about to overwrite.
      const std::uint64_t n =
          reader.records() > SharedRecords::kRecords ? reader.records() - SharedRecords::kRecords : 0;
      if (n == 0) continue;  // made by the loop, with other numbers
      const std::size_t slot = reader.slot(n);
      const std::uint64_t before = reader.count(slot);
      std::atomic_thread_fence(std::memory_order_acquire);
      const double a = reader.value<double>(slot + at_first), b = reader.value<double>(slot + at_last);
      std::atomic_thread_fence(std::memory_order_acquire);
      if (before != 2 * n + 2 || reader.count(slot) != before) {
        ++overtaken;
        continue;
      }
      ++whole;
      EXPECT_EQ(a, b);
    }
  });
  for (std::uint64_t n = 0; n < 20 * SharedRecords::kRecords; ++n) {
    record.arms[0].q[0] = record.arms[1].tau_cmd[0] = static_cast<double>(n);
    fixture.shared.take(record, {});
  }
  end = true;
  reading.join();
  EXPECT_GT(whole + overtaken, 0u);
}

TEST(SharedRecordsTest, EventsAreTextAndLongOnesAreCut) {
  Fixture fixture;
  fixture.shared.take(
      RunEvent{.cycle = 12, .t = LoopTime{34}, .kind = "error", .arm = "arm0", .text = "why"});
  fixture.shared.take(
      RunEvent{.cycle = 13, .t = {}, .kind = "error", .arm = "arm0", .text = std::string(5000, 'x')});
  const Reader& reader = fixture.reader;
  EXPECT_EQ(reader.count(80), 2u);
  EXPECT_EQ(json::parse(reader.event(0)), (json{{"kind", "error"}, {"arm", "arm0"}, {"text", "why"}}));
  const std::size_t at = reader.table["first_event"];
  EXPECT_EQ(reader.count(at + 8), 12u);
  EXPECT_EQ(reader.count(at + 16), 34u);
  const std::string cut = json::parse(reader.event(1))["text"];
  EXPECT_GT(cut.size(), 500u);
  EXPECT_LT(cut.size(), 1000u);
}

TEST(SharedRecordsTest, WhatTheLoopDroppedIsCounted) {
  Fixture fixture;
  fixture.shared.count_lost(3, 1);
  fixture.shared.count_lost(2, 0);
  EXPECT_EQ(fixture.reader.count(72), 5u);
  EXPECT_EQ(fixture.reader.count(88), 1u);
}

}  // namespace
}  // namespace multipanda::shared_records_test

#include "cockpit/log/log_table.hpp"

#include <cmath>
#include <cstdlib>
#include <fstream>

#include <gtest/gtest.h>

#include "runtime/live_input/json_fields.hpp"
#include "runtime/session.hpp"
#include "scene/load.hpp"

namespace multipanda::cockpit::log_table_test {
namespace {

using nlohmann::json;

// A run as fast as possible and its records, as they came from the loop.
struct RecordedRun {
  explicit RecordedRun(const std::string& every = "objects=16") {
    std::string pattern = (std::filesystem::temp_directory_path() / "cockpit_log_XXXXXX").string();
    folder = mkdtemp(pattern.data());
    OpenedScene opened = open_scene("one_arm");
    SessionOptions options{.paced = false, .duration_s = 0.5, .record = folder};
    options.log_every.set(every);
    options.observer = [this](const CycleRecord& record) { records.push_back(record); };
    Session session(std::move(opened.scene), opened.registry, std::move(options));
    session.start();
    while (!session.wait_for_end(1)) {
    }
    log = session.finish().log;
  }
  ~RecordedRun() { std::filesystem::remove_all(folder); }

  std::filesystem::path folder, log;
  std::vector<CycleRecord> records;
};

const RecordedRun& run() {
  static const RecordedRun kRun;
  return kRun;
}

const RecordReader::Field& field(const LogTable& table, const std::string& name) {
  const auto found = std::ranges::find(table.fields(), name, &RecordReader::Field::name);
  if (found == table.fields().end()) throw std::runtime_error("no field " + name);
  return *found;
}

TEST(LogTable, HasEveryCycleOfAShortLog) {
  const LogTable table(run().log);
  ASSERT_EQ(table.rows(), run().records.size());
  EXPECT_EQ(table.every(), 1u);
  for (std::size_t row = 0; row < table.rows(); ++row) {
    const CycleRecord& record = run().records[row];
    const ArmSample& arm = record.arms[0];
    EXPECT_NEAR(table.t_s(row), record.t.seconds(), 1e-9);
    EXPECT_EQ(table.value(row, field(table, "cycle"), 0), static_cast<double>(record.cycle));
    EXPECT_EQ(table.value(row, field(table, "arm/owner"), 0), arm.owner);
    for (std::size_t k = 0; k < 7; ++k) {
      EXPECT_EQ(table.value(row, field(table, "arm/q_rad"), k), static_cast<float>(arm.q[k]));
      EXPECT_EQ(table.value(row, field(table, "arm/tau_cmd_nm"), k), static_cast<float>(arm.tau_cmd[k]));
    }
  }
  EXPECT_FALSE(table.events().empty());
}

// By the walk over the table of core/state/arm_sample.hpp; in single precision.
TEST(LogTable, HasEveryQuantityOfTheArm) {
  const LogTable table(run().log);
  FieldList list(0);
  visit_sample(list, ArmSample{}, 7);
  std::vector<double> expected(list.offset() / 8);
  for (std::size_t row = 0; row < table.rows(); row += 10) {  // those with a report of the arm
    const ArmSample& arm = run().records[row].arms[0];
    NumberWriter writer(expected.data());
    visit_sample(writer, arm, 7);
    EXPECT_TRUE(arm.has_report);
    for (const RecordField& one : list.fields()) {
      if (one.name.starts_with("gripper_") && !arm.has_gripper) continue;
      for (std::size_t k = 0; k < one.count; ++k) {
        const double found = table.value(row, field(table, "arm/" + one.name), k);
        const double number = expected[one.offset / 8 + k];
        if (std::isnan(number)) {
          EXPECT_TRUE(std::isnan(found)) << one.name;
        } else {
          EXPECT_EQ(found, static_cast<float>(number)) << one.name;
        }
      }
    }
  }
}

// Two algorithms for the end effector's place: the table's, and the model's at the record's joints.
TEST(LogTable, PlacesTheEndEffector) {
  const LogTable table(run().log);
  ModelTerms terms(table.models()[0]);
  const CycleRecord& record = run().records.back();
  terms.set_config(table.frames(table.rows() - 1)[0], {}, {});
  const Eigen::Map<const Eigen::VectorXd> q(record.arms[0].q.data(), 7);
  terms.update(JointVector(q), JointVector::Zero(7));
  for (int k = 0; k < 3; ++k)
    EXPECT_NEAR(table.value(table.rows() - 1, field(table, "arm/position_m"), static_cast<std::size_t>(k)),
                terms.X_WE().position[k], 1e-6);
}

// The box of the scene stands on the table: the log has it, and one without such messages, as older ones,
// opens and leaves it where the scene has it.
TEST(LogTable, KnowsWhereFreeObjectsAreIfTheLogDoes) {
  const LogTable table(run().log);
  const RecordedRun without("objects=0");
  const LogTable older(without.log);
  const auto& objects = table.scene().objects;
  std::size_t known = 0;
  for (std::size_t i = 0; i < objects.size(); ++i) {
    const auto X = table.objects(table.rows() - 1)[i];
    EXPECT_EQ(X.has_value(), !objects[i].fixed) << objects[i].name;
    EXPECT_FALSE(older.objects(older.rows() - 1)[i]);
    if (!X) continue;
    ++known;
    EXPECT_LT((X->position - objects[i].X_WO.position).norm(), 5e-3);
    EXPECT_NE(X->position, objects[i].X_WO.position);
  }
  EXPECT_GT(known, 0u);
  EXPECT_EQ(older.rows(), table.rows());
}

TEST(LogTable, ALongLogIsThinnedEvenly) {
  const LogTable table(run().log, 100);
  EXPECT_EQ(table.every(), 8u);  // 500 cycles in fewer than 100 rows
  EXPECT_EQ(table.rows(), (run().records.size() + 7) / 8);
  for (std::size_t row = 0; row < table.rows(); ++row)
    EXPECT_EQ(table.value(row, field(table, "cycle"), 0), static_cast<double>(run().records[8 * row].cycle))
        << row;
}

TEST(LogTable, FindsRowsByTime) {
  const LogTable table(run().log);
  EXPECT_EQ(table.row_at(-1), 0u);
  EXPECT_EQ(table.row_at(1e9), table.rows() - 1);
  EXPECT_EQ(table.row_at(table.t_s(7) + 0.0004), 7u);
}

TEST(LogTable, RefusesWhatIsNoLog) {
  const auto file = run().folder / "other.mcap";
  std::ofstream(file) << "text";
  EXPECT_THROW(LogTable{file}, std::runtime_error);
}

class LogSourceTest : public testing::Test {
 protected:
  LogSourceTest() {
    std::vector<std::unique_ptr<LogTable>> logs;
    logs.push_back(std::make_unique<LogTable>(run().log));
    logs.push_back(std::make_unique<LogTable>(run().log, 100));
    source_ = std::make_unique<LogSource>(std::move(logs));
  }
  Reply ask(const json& request) { return std::get<Reply>(source_->ask(request, host_now())); }
  static std::vector<double> numbers(const Reply& reply) {
    std::vector<double> values((reply.numbers.size() - 16) / 8);
    std::memcpy(values.data(), reply.numbers.data() + 16, 8 * values.size());
    return values;
  }
  std::unique_ptr<LogSource> source_;
};

TEST_F(LogSourceTest, GivesColumns) {
  const Reply reply =
      ask({{"do", "log_columns"}, {"fields", {"arm/q_rad", "cycle"}}, {"from_s", 0.1}, {"to_s", 0.2}});
  EXPECT_EQ(reply.answer["columns"], json::parse(R"([["arm/q_rad", 7], ["cycle", 1]])"));
  const auto values = numbers(reply);
  ASSERT_EQ(values.size() % 9, 0u);
  EXPECT_NEAR(values[0], 0.1, 1e-3);
  EXPECT_NEAR(values[values.size() - 9], 0.2, 1e-3);
  const Reply thin =
      ask({{"do", "log_columns"}, {"fields", {"cycle"}}, {"from_s", 0}, {"to_s", 9}, {"rows", 50}});
  EXPECT_LE(numbers(thin).size(), 2 * 50u);
  EXPECT_GE(numbers(thin).size(), 2 * 25u);
}

TEST_F(LogSourceTest, GivesStatesOfBothLogs) {
  const std::size_t width = [&] {
    std::size_t sum = 1;  // the time
    const json hello = source_->hello();
    for (const auto& state_field : hello["state_fields"]) sum += state_field[1].get<std::size_t>();
    return sum;
  }();
  for (const int log : {0, 1}) {
    EXPECT_EQ(numbers(ask({{"do", "log_state"}, {"log", log}, {"t_s", 0.2}})).size(), width);
    const auto states =
        numbers(ask({{"do", "log_states"}, {"log", log}, {"from_s", 0}, {"to_s", 0.4}, {"rate_hz", 50}}));
    EXPECT_LE(states.size(), 20 * width);
    EXPECT_GE(states.size(), 10 * width);
  }
}

TEST_F(LogSourceTest, RefusesWhatItDoesNotHave) {
  for (const json& wrong :
       {json{{"do", "log_state"}, {"t_s", 0}, {"log", 2}},
        json{{"do", "log_state"}, {"t_s", 0}, {"log", 0.5}}, json{{"do", "log_state"}, {"t_s", "now"}},
        json{{"do", "log_states"}, {"from_s", 1}, {"to_s", 0}},
        json{{"do", "log_columns"}, {"fields", {"arm/q"}}, {"from_s", 0}, {"to_s", 1}},
        json{{"do", "log_columns"}, {"fields", {"arm/q_rad"}}, {"from_s", 0}, {"to_s", 1}, {"rows", 1e6}}})
    EXPECT_THROW(ask(wrong), RequestRefused) << wrong;
}

}  // namespace
}  // namespace multipanda::cockpit::log_table_test

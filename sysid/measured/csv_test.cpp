#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "logs/testing/test_files.hpp"
#include "sysid/measured/measured_log.hpp"
#include "sysid/measured/testing/test_logs.hpp"

namespace multipanda::csv_test {
namespace {

using testing::AllOf;
using testing::HasSubstr;

class CsvLogs : public testing::Test {
 protected:
  std::filesystem::path put(const std::string& name, const std::string& content) {
    put_content(folder_ / name, content);
    return folder_ / name;
  }
  // The text of the refusal; empty: the file was read.
  static std::string refusal(const std::filesystem::path& path, const MeasuredLogOptions& options = {}) {
    try {
      read_measured(path, options);
      return "";
    } catch (const LogRefused& error) {
      return error.what();
    }
  }
  // The lines of a valid file of 200 samples, for tests to damage: line 1 names, line k + 2 sample k.
  std::vector<std::string> good_lines() {
    write_plain_csv(swinging_log(0.2), folder_ / "good.csv");
    std::vector<std::string> lines;
    std::ifstream file(folder_ / "good.csv");
    for (std::string line; std::getline(file, line);) lines.push_back(line);
    return lines;
  }
  std::filesystem::path put_lines(const std::vector<std::string>& lines) {
    std::string all;
    for (const auto& line : lines) all += line + "\n";
    return put("corrupted.csv", all);
  }
  TestFolder folder_;
};

TEST_F(CsvLogs, PlainColumnsAreRecognizedForAnyNumberOfJoints) {
  for (const Eigen::Index joints : {1, 6, 7}) {
    const MeasuredLog written = swinging_log(0.5, joints);
    write_plain_csv(written, folder_ / "log.csv");
    const auto logs = read_measured(folder_ / "log.csv");
    ASSERT_EQ(logs.size(), 1u);
    EXPECT_EQ(logs[0].joints(), joints);
    EXPECT_EQ(logs[0].t, written.t);
    EXPECT_EQ(logs[0].q, written.q);
    EXPECT_EQ(logs[0].dq, written.dq);
    EXPECT_EQ(logs[0].tau, written.tau);
    EXPECT_EQ(logs[0].x_EE.rows(), 0);
    EXPECT_TRUE(logs[0].warnings.empty());
    EXPECT_EQ(logs[0].lines[3], 5u);
  }
}

// Names of `multipanda export --csv`, and those that it wrote before names had units.
TEST_F(CsvLogs, ReadsExportedTables) {
  const MeasuredLog truth = swinging_log(0.3, 2);
  std::ostringstream file;
  file.precision(17);
  file << "t_s,cycle,q_1_rad,q_2_rad,dq_1_rad_per_s,dq_2_rad_per_s,tau_j_1_nm,tau_j_2_nm";
  for (Eigen::Index k = 0; k < truth.samples(); ++k) {
    file << '\n' << truth.t[k] << ',' << k;
    for (const auto* matrix : {&truth.q, &truth.dq, &truth.tau})
      file << ',' << (*matrix)(k, 0) << ',' << (*matrix)(k, 1);
  }
  const auto log = read_measured(put("table.csv", file.str() + "\n")).at(0);
  EXPECT_EQ(log.t, truth.t);
  EXPECT_EQ(log.q, truth.q);
  EXPECT_EQ(log.dq, truth.dq);
  EXPECT_EQ(log.tau, truth.tau);
}

// As franka::logToCSV writes it: time in ms, names with indices, blanks after some commas.
TEST_F(CsvLogs, ReadsLogsOfLibfranka) {
  const MeasuredLog truth = swinging_log(0.3);
  std::ostringstream file;
  file.precision(17);
  const auto names = [&](const std::string& name, int count) {
    for (int i = 0; i < count; ++i) file << (i > 0 ? ", " : ",") << name << '[' << i << ']';
  };
  file << "time, success_rate";
  names("state.q", 7), names("state.q_d", 7), names("state.dq", 7), names("state.dq_d", 7);
  names("state.tau_J", 7), names("state.tau_ext_hat_filtered", 7), names("cmd.q_d", 7), names("cmd.dq_d", 7);
  names("cmd.O_T_EE_d", 16), names("cmd.O_dP_EE_d", 6), names("cmd.tau_J_d", 7);
  for (Eigen::Index k = 0; k < truth.samples(); ++k) {
    file << '\n' << 81234 + k << ",1";
    const auto row = [&](const auto& values) {
      for (Eigen::Index j = 0; j < 7; ++j) file << ',' << values[j];
    };
    const auto constant = [&](int count, double value) {
      for (int i = 0; i < count; ++i) file << ',' << value;
    };
    row(truth.q.row(k)), constant(7, 9), row(truth.dq.row(k)), constant(7, 9), row(truth.tau.row(k));
    constant(7, 9), constant(14, 9), constant(22, 0);
    for (Eigen::Index j = 0; j < 7; ++j) file << ',' << 0.5 * truth.tau(k, j);
  }
  file << '\n';
  const auto log = read_measured(put("manufacturer.csv", file.str())).at(0);
  EXPECT_NEAR(log.t[0], 81.234, 1e-12);
  EXPECT_NEAR(log.duration(), 0.3, 1e-9);
  EXPECT_EQ(log.q, truth.q);
  EXPECT_EQ(log.dq, truth.dq);
  EXPECT_EQ(log.tau, truth.tau);
  EXPECT_EQ(log.tau_cmd, 0.5 * truth.tau);
  EXPECT_EQ(log.tau_d, log.tau_cmd);
}

TEST_F(CsvLogs, AColumnMapNamesColumnsFamiliesAndFactors) {
  const MeasuredLog truth = swinging_log(0.3, 2);
  std::ostringstream file;
  file.precision(17);
  file << "# recorded by hand\nstamp_ms;arm;pos_1;pos_2;v0;v1;effort a;effort b\n";
  for (Eigen::Index k = 0; k < truth.samples(); ++k) {
    file << 1e3 * truth.t[k] << ";\"left; upper\";" << truth.q(k, 0) << ';' << truth.q(k, 1) << ';'
         << truth.dq(k, 0) << ';' << truth.dq(k, 1) << ';' << truth.tau(k, 0) << ';' << truth.tau(k, 1)
         << "\r\n";
  }
  const auto path = put("own.csv", file.str());
  const auto map =
      put("map.yaml", "t: stamp_ms * 0.001\nq: pos_{}\ndq: v{0}\ntau1: effort a\ntau2: effort b\n");
  MeasuredLogOptions options;
  options.columns = read_column_map(map.string());
  const auto log = read_measured(path, options).at(0);
  EXPECT_LT((log.t - truth.t).cwiseAbs().maxCoeff(), 1e-12);
  EXPECT_EQ(log.q, truth.q);
  EXPECT_EQ(log.dq, truth.dq);
  EXPECT_EQ(log.tau, truth.tau);
  EXPECT_EQ(log.lines[0], 3u);

  options.columns = read_column_map("t=stamp_ms * 0.001,q=pos_{},dq=v{0},tau=effort {}");
  EXPECT_THAT(refusal(path, options),
              AllOf(HasSubstr("own.csv:2"), HasSubstr("'effort 1'"), HasSubstr("effort a")));
  options.columns["speed1"] = "v0";
  options.columns.erase("tau");
  options.columns["tau1"] = "effort a", options.columns["tau2"] = "effort b";
  EXPECT_THAT(refusal(path, options), HasSubstr("'speed1' is not a known name"));
  EXPECT_THAT(refusal(path),
              AllOf(HasSubstr("no column of time"), HasSubstr("stamp_ms"), HasSubstr("--columns")));
  EXPECT_THROW(read_column_map("t"), LogRefused);
  try {
    read_column_map(put("bad.yaml", "t: time\nq: [a, b]\n").string());
    FAIL();
  } catch (const LogRefused& error) {
    EXPECT_THAT(error.what(), HasSubstr("bad.yaml:2"));
  }
}

// A base turned by roll, pitch, yaw shows gravity as the third row of its rotation, downwards:
// (sin p, -cos p sin r, -cos p cos r) * 9.81.
TEST_F(CsvLogs, ALineBeforeTheNamesTellsTheBase) {
  auto lines = good_lines();
  EXPECT_FALSE(read_measured(put_lines(lines)).at(0).gravity_B);
  lines.insert(lines.begin(), {"# recorded by hand", "# base_rpy_rad: 0.3, -0.5 2"});
  const auto log = read_measured(put_lines(lines)).at(0);
  ASSERT_TRUE(log.gravity_B);
  const Eigen::Vector3d expected(std::sin(-0.5), -std::cos(0.5) * std::sin(0.3),
                                 -std::cos(0.5) * std::cos(0.3));
  EXPECT_LT((*log.gravity_B - 9.81 * expected).norm(), 1e-12);
  EXPECT_EQ(log.lines[0], 4u);
  for (const char* bad : {"# base_rpy_rad: 0 1", "# base_rpy_rad: 0 a 1", "#base_rpy_rad: 0 nan 1"}) {
    lines[1] = bad;
    EXPECT_THAT(refusal(put_lines(lines)),
                AllOf(HasSubstr("corrupted.csv:2"), HasSubstr("expected 3 numbers")));
  }
}

TEST_F(CsvLogs, NonNumbersAreRefusedWithTheirLine) {
  auto lines = good_lines();
  lines[41] = "0.04,nan" + lines[41].substr(lines[41].find(',', lines[41].find(',') + 1));
  EXPECT_THAT(refusal(put_lines(lines)), AllOf(HasSubstr("corrupted.csv:42"), HasSubstr("'q1' is nan")));
  lines[41] = "0.04,three" + lines[41].substr(8);
  EXPECT_THAT(refusal(put_lines(lines)), AllOf(HasSubstr("corrupted.csv:42"), HasSubstr("'three'")));
  lines[41] = "0.04,1,2";
  EXPECT_THAT(refusal(put_lines(lines)),
              AllOf(HasSubstr("corrupted.csv:42"), HasSubstr("3 cells"), HasSubstr("22")));
}

TEST_F(CsvLogs, AnIncompleteLastRowIsLeftOut) {
  auto lines = good_lines();
  std::string all;
  for (std::size_t i = 0; i + 1 < lines.size(); ++i) all += lines[i] + "\n";
  const auto log = read_measured(put("cut.csv", all + "0.2,0.1,0.")).at(0);
  EXPECT_EQ(log.samples(), 200);
  ASSERT_EQ(log.warnings.size(), 1u);
  EXPECT_THAT(log.warnings[0], HasSubstr("line 202"));
}

TEST_F(CsvLogs, MissingColumnsAreRefusedOrAllowed) {
  EXPECT_THAT(refusal(put("a.csv", "t,q1,q2,dq1,tau1,tau2\n0,0,0,0,0,0\n")),
              AllOf(HasSubstr("a.csv:1"), HasSubstr("1 columns of dq, expected 2")));
  EXPECT_THAT(refusal(put("b.csv", "0,1,2\n0,0,0\n")),
              AllOf(HasSubstr("b.csv:1"), HasSubstr("row of names")));
  EXPECT_THAT(refusal(put("c.csv", "")), HasSubstr("empty"));
  EXPECT_THAT(refusal(folder_ / "none.csv"), HasSubstr("no such file"));
  std::string only_q = "t,q1\n";
  for (int k = 0; k < 200; ++k) only_q += std::to_string(0.001 * k) + "," + std::to_string(0.0001 * k) + "\n";
  const auto path = put("d.csv", only_q);
  EXPECT_THAT(refusal(path), HasSubstr("no column dq1"));
  MeasuredLogOptions options;
  options.needs_dynamics = false;
  EXPECT_EQ(read_measured(path, options).at(0).dq.rows(), 0);
}

TEST_F(CsvLogs, RepeatsAreFoundInTheOrderOfTheirNumbers) {
  for (const char* name : {"run_10.csv", "run_2.csv", "run_1.csv", "notes.txt"}) put(name, "x");
  std::filesystem::create_directories(folder_ / "run_3");
  put("run_3/log.mcap", "x");
  const auto repeats = find_repeats(folder_.path());
  std::vector<std::string> names;
  for (const auto& path : repeats) names.push_back(path.filename().string());
  EXPECT_THAT(names, testing::ElementsAre("run_1.csv", "run_2.csv", "run_3", "run_10.csv"));
  EXPECT_THAT(find_repeats(folder_ / "run_3"), testing::ElementsAre(folder_ / "run_3"));
  std::filesystem::create_directories(folder_ / "empty");
  EXPECT_THROW(find_repeats(folder_ / "empty"), LogRefused);
}

TEST_F(CsvLogs, BrokenFilesOfOtherKindsAreNamed) {
  for (const char* name : {"run.npz", "bag_0.db3"})
    EXPECT_THAT(refusal(put(name, "x")), HasSubstr(std::string(name) + ": cannot be read: ")) << name;
}

// The recorded file of a real arm, if it is available.
TEST(RealLog, IsReadUnmapped) {
  const std::filesystem::path path =
      std::filesystem::path(MULTIPANDA_SOURCE_DIR) / "../shared/data/panda_excitation.csv";
  if (!std::filesystem::exists(path)) GTEST_SKIP() << path << " is not here";
  const auto log = read_measured(path).at(0);
  EXPECT_EQ(log.samples(), 7431);
  EXPECT_EQ(log.joints(), 7);
  EXPECT_NEAR(log.duration(), 7.499, 1e-3);
  for (const auto& warning : log.warnings) EXPECT_THAT(warning, HasSubstr("gaps in time"));
}

}  // namespace
}  // namespace multipanda::csv_test

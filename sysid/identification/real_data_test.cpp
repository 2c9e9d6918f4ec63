// 7.5 s of exciting motion of a real Panda: chosen within the file, tested on motion that was not fitted.
// Skipped without the data next to the project (../shared/data).
#include <cmath>
#include <filesystem>
#include <unistd.h>

#include <fmt/format.h>
#include <gtest/gtest.h>

#include "models/write_robot.hpp"
#include "sysid/identification/identify.hpp"
#include "sysid/identification/predict.hpp"

namespace multipanda::real_data_test {
namespace {

namespace fs = std::filesystem;

class RealPanda : public ::testing::Test {
 protected:
  void SetUp() override {
    const fs::path data = fs::path(MULTIPANDA_SOURCE_DIR) / "../shared/data";
    if (!fs::exists(data / "panda_excitation.csv")) GTEST_SKIP() << "no data in " << data;
    first_ = read_measured(data / "panda_excitation.csv").front();
    second_ = read_measured(data / "panda_excitation_second_period.csv").front();
  }
  static double beside(const Identification& id, const std::string& name) {
    for (const ModelBeside& model : id.beside) {
      if (model.name == name) return model.mean;
    }
    return NAN;
  }
  MeasuredLog first_, second_;
};

MeasuredLog part(const MeasuredLog& log, double from, double to) {
  MeasuredLog out;
  out.source = log.source;
  std::vector<Eigen::Index> rows;
  for (Eigen::Index i = 0; i < log.samples(); ++i) {
    if (log.t[i] >= from && log.t[i] <= to) rows.push_back(i);
  }
  out.t = log.t(rows);
  out.q = log.q(rows, Eigen::all);
  out.dq = log.dq(rows, Eigen::all);
  out.tau = log.tau(rows, Eigen::all);
  return out;
}

TEST_F(RealPanda, is_predicted_better_than_by_published_parameters_with_physical_bodies) {
  const Identification id = identify(std::vector{first_}, load_robot("fer"));
  for (const FamilyScore& score : id.scores) {
    fmt::print("{} {:<48} {:3} {:.4f}\n", score.chosen ? '*' : ' ', score.name, score.coefficients,
               score.mean);
  }
  double chosen = NAN;
  for (const FamilyScore& score : id.scores) {
    if (score.chosen) chosen = score.mean;
  }
  EXPECT_LE(chosen, 0.105);                  // blocked cross-validation; about 0.085 when it was tried
  EXPECT_LE(id.rmse_heldout.mean(), 0.115);  // last third, never fitted, as a separate file
  // What 60 % of the file let expect of the rest, from either end.
  int compared = 0;
  for (const TimeCut& cut : id.cuts) {
    if (std::abs(cut.to - cut.from - 0.6) > 1e-9) continue;
    EXPECT_NEAR(cut.rmse_expected.mean() / cut.rmse_test.mean(), 1, 0.25) << cut.from;
    ++compared;
  }
  EXPECT_EQ(compared, 2);
  EXPECT_GT(id.rmse_all.mean(), 0.03);  // below the noise with measured ddq it would be overfitted
  EXPECT_TRUE(id.consistent);
  EXPECT_TRUE(id.dissipative);
  // Published parameters on these 7.5 s, computed independently: 0.395 rigid, 0.242 with their friction.
  EXPECT_NEAR(beside(id, "fer"), 0.395, 0.002);
  EXPECT_NEAR(beside(id, "fer with its friction table"), 0.242, 0.003);
  EXPECT_EQ(id.linear.base.rank(), 43);
  EXPECT_LT(id.linear.condition.scaled, 60);

  // Writes the model, reads it back and tries it on the next period of the same motion.
  const fs::path file = fs::temp_directory_path() / fmt::format("multipanda_real_panda_{}.yaml", ::getpid());
  RobotDescription robot = id.robot;
  robot.name = file.stem().string();
  write_robot(robot, load_robot("fer"), file);
  const Prediction again = predict(second_, load_robot(file.string()));
  fs::remove(file);
  EXPECT_NEAR(again.rmse_mean, predict(second_, id.robot).rmse_mean, 1e-12);
  EXPECT_LT(again.rmse_mean, 0.075);
  EXPECT_GT(again.rmse_mean, 0.05);  // below 0.05 on repeated motion would be overfitted
  EXPECT_LT(again.rmse_unfiltered.mean(), 0.3);
}

// Joint 5 stays within 0.01 rad of another place in each file. Without its start it was off by 0.15 to 0.2
// N m there.
TEST_F(RealPanda, as_is_a_research_3_from_another_file) {
  const fs::path data = fs::path(MULTIPANDA_SOURCE_DIR) / "../shared/data";
  const MeasuredLog two = read_measured(data / "fr3_circle_2.csv").front(),
                    three = read_measured(data / "fr3_circle_3.csv").front();
  IdentifyOptions options;
  options.hand = true;
  PredictOptions how;
  how.hand = true;
  for (const auto& [fitted, other] : {std::pair{two, three}, {three, two}}) {
    const Identification id = identify(std::vector{fitted}, load_robot("fr3"), options);
    const Prediction found = predict(other, id.robot, how);
    fmt::print("{} expected {:.4f} found {:.4f}, joint 5 {:.4f}\n", id.family, id.rmse_expected.mean(),
               found.rmse_mean, found.rmse[4]);
    EXPECT_LT(found.rmse_mean, 0.125);
    EXPECT_LT(found.rmse[4], 0.1);
    EXPECT_NEAR(id.rmse_expected.mean() / found.rmse_mean, 1, 0.25);
    EXPECT_NE(outside_range(other, id.robot), "");
  }
}

TEST_F(RealPanda, is_predicted_on_motion_that_was_not_fitted) {
  // The family chosen on all data; parameters of the first 5 s only, tested on the rest.
  IdentifyOptions options;
  options.families = {"stribeck+presliding6+tilt+gains"};
  options.choose = false;
  const Identification id = identify(std::vector{part(first_, 0, 5)}, load_robot("fer"), options);
  const Prediction new_motion = predict(part(first_, 5, 7.5), id.robot);
  EXPECT_LE(new_motion.rmse_mean, 0.115);
  EXPECT_LT(new_motion.rmse_mean, 0.6 * predict(part(first_, 5, 7.5), load_robot("fer")).rmse_mean);
}

TEST_F(RealPanda, first_half_predicts_the_second_half_better_than_published_parameters) {
  IdentifyOptions options;
  options.families = {"stribeck+presliding6+tilt+gains"};
  options.choose = false;
  const Identification id = identify(std::vector{part(first_, 0, 3.75)}, load_robot("fer"), options);
  PredictOptions with_friction;
  with_friction.motor_friction = true;
  const MeasuredLog half = part(first_, 3.75, 7.5);
  const double published = predict(half, load_robot("fer"), with_friction).rmse_mean;
  EXPECT_LT(predict(half, id.robot).rmse_mean, 0.85 * published);
}

}  // namespace
}  // namespace multipanda::real_data_test

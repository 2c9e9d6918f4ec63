#include <filesystem>
#include <fstream>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "experiments/study/study.hpp"

namespace multipanda::study_load_test {
namespace {

namespace fs = std::filesystem;
using testing::Contains;
using testing::ElementsAre;
using testing::EndsWith;
using testing::HasSubstr;

const fs::path kFolder = fs::path(MULTIPANDA_BINARY_DIR) / "study_files";

Study read(const std::string& text) {
  fs::create_directories(kFolder);
  const fs::path file = kFolder / "study.yaml";
  std::ofstream(file) << text;
  return load_study(file.string());
}

std::string refusal(const std::string& text) {
  try {
    (void)read(text);
  } catch (const std::invalid_argument& error) {
    return error.what();
  }
  return "not refused";
}

TEST(Studies, ExamplesAreAccepted) {
  int found = 0;
  for (const auto& entry : fs::directory_iterator(MULTIPANDA_SOURCE_DIR "/examples/studies")) {
    if (entry.path().extension() != ".yaml") continue;
    EXPECT_NO_THROW((void)load_study(entry.path().string())) << entry.path();
    ++found;
  }
  EXPECT_GE(found, 4);
}

TEST(Studies, AreReadAsWritten) {
  const Study study = read(
      "title: T\nscene: one_arm\nseconds: 0.5\nset: {plant.fidelity: realistic}\n"
      "axes:\n  - {name: k, key: controllets.cartesian.parameters.translational_stiffness_n_per_m, values: "
      "[1, 2]}\n"
      "seeds: {first: 4, count: 3}\nvary: [{key: objects.box.mass_kg, by: 0.01}]\n");
  EXPECT_EQ(study.title, "T");
  EXPECT_EQ(study.seconds, 0.5);
  EXPECT_EQ(study.first_seed, 4U);
  EXPECT_EQ(study.seed_count, 3U);
  ASSERT_EQ(study.axes.size(), 1U);
  EXPECT_EQ(study.axes[0].choices.at(1).name, "2");
  EXPECT_EQ(study.axes[0].choices.at(1).set.at(0).value, "2");
  const auto json = to_json(study);
  EXPECT_EQ(json["seeds"]["count"], 3);
  EXPECT_TRUE(fs::path(json["base"].get<std::string>()).is_absolute());
}

// A result must not outlive a change of a file that only a later choice names.
TEST(Studies, FilesOfEveryChoiceCount) {
  fs::create_directories(kFolder);
  const std::string own = (kFolder / "own_arm.yaml").string();
  std::ofstream(own) << "name: own_arm\ntitle: Own\nbase: fer\n";
  const std::string choices =
      "axes: [{name: arm, choices: [{name: a}, {name: b, set: {arms.arm.plant_model: " + own + "}}]}]\n";
  EXPECT_THAT(study_files(read("scene: one_arm\nseconds: 1\n" + choices)), Contains(own));
  EXPECT_THAT(study_files(read("experiment: task-1\n" + choices)), Contains(own));
  const auto refined = study_files(
      read("refine: task-1\naxes: [{name: t, choices: [{name: a}, {name: b, set: {refine: task-4}}]}]\n"));
  EXPECT_THAT(refined, Contains(EndsWith("scenes/task_4.yaml")));
}

TEST(Studies, AnInvalidFileSaysWhatIsWrong) {
  EXPECT_THAT(refusal("scene: one_arm\nexperiment: task-1\n"), HasSubstr("expected one of the keys"));
  EXPECT_THAT(refusal("scene: one_arm\nseconds: 1\nseeds: {count: 2}\nseed_list: [1]\n"),
              HasSubstr("exclude each other"));
  EXPECT_THAT(refusal("scene: one_arm\nseconds: 1\nseed_list: [1.5]\n"), HasSubstr("whole numbers"));
  EXPECT_THAT(refusal("scene: one_arm\nseconds: 1\naxes: [{name: a, key: plant.fidelity}]\n"),
              HasSubstr("belong together"));
  EXPECT_THAT(
      refusal("scene: one_arm\nseconds: 1\naxes: [{name: a, key: plant.fidelity, values: [ideal, ideal]}]\n"),
      HasSubstr("names must differ"));
  EXPECT_THAT(
      refusal("scene: one_arm\nseconds: 1\naxes: [{name: a, key: plant.fidelity, values: [ideal, odd]}]\n"),
      HasSubstr("choice 'odd'"));
  EXPECT_THAT(refusal("experiment: task-1\nset: {controllets.0.paramters.x: 1}\n"), HasSubstr("parameters"));
  EXPECT_THAT(refusal("experiment: task-1\nonly: [nothing]\n"), HasSubstr("nothing"));
  EXPECT_THAT(refusal("experiment: controller-performance\nset: {a: 1}\n"), HasSubstr("runs a scene"));
  EXPECT_THAT(refusal("refine: task-4\nset: {round: 2}\n"), HasSubstr("'rounds'"));
  EXPECT_THAT(refusal("refine: task-4\nlogs: true\n"), HasSubstr("no meaning"));
  EXPECT_THAT(refusal("experiment: task-1\naxes: [{name: v, key: only, values: [plain, nothing]}]\n"),
              HasSubstr("choice 'nothing'"));
  EXPECT_THAT(refusal("scene: one_arm\nseconds: 1\nfiles: [.]\n"), HasSubstr("no meaning"));
  EXPECT_THAT(refusal("program: []\n"), HasSubstr("no words"));
  EXPECT_THAT(refusal("program: [./nothing, '{out}']\n"), HasSubstr("there is no program"));
  EXPECT_THAT(refusal("program: [x, '{seed}']\n"), HasSubstr("{out}"));
  EXPECT_THAT(refusal("program: [x, '{out}', '{mode}']\n"), HasSubstr("{mode} in `program` has no value"));
  EXPECT_THAT(refusal("program: [x, '{out}']\nset: {mode: 1}\n"), HasSubstr("contains {mode}"));
  EXPECT_THAT(refusal("program: [x, '{out}']\nset: {seed: 1}\n"), HasSubstr("another name"));
  EXPECT_THAT(refusal("program: [x, '{out}']\nvary: [{key: a, by: 1}]\n"), HasSubstr("no meaning"));
  EXPECT_THAT(refusal("program: [x, '{out}']\nfiles: [nothing]\n"), HasSubstr("there is no"));
}

// A program and what it reads decide about its results.
TEST(Studies, FilesOfAProgramCount) {
  const fs::path data = kFolder / "data";
  fs::create_directories(data / "deep");
  std::ofstream(kFolder / "evaluate.py") << "1\n";
  std::ofstream(data / "deep" / "a.txt") << "2\n";
  const Study study = read(
      "program: [python3, evaluate.py, --mode, '{mode}', --out, '{out}']\nfiles: [data]\n"
      "axes: [{name: mode, key: mode, values: [slow, fast]}]\n");
  EXPECT_THAT(study_files(study),
              ElementsAre((data / "deep" / "a.txt").string(), (kFolder / "evaluate.py").string()));
  EXPECT_THAT(study.program, ElementsAre("python3", (kFolder / "evaluate.py").string(), "--mode", "{mode}",
                                         "--out", "{out}"));
}

}  // namespace
}  // namespace multipanda::study_load_test

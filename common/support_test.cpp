#include <csignal>
#include <cstdlib>
#include <filesystem>
#include <sys/wait.h>
#include <thread>
#include <unistd.h>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "common/machine.hpp"
#include "common/own_files.hpp"
#include "common/process.hpp"

namespace multipanda {

namespace {

using testing::HasSubstr;

TEST(Address, OnlyTheLoopbackNetIsOnThisComputer) {
  for (const char* here : {"127.0.0.1", "127.255.9.1", "localhost"})
    EXPECT_TRUE(is_on_this_computer(here)) << here;
  for (const char* elsewhere : {"172.16.0.2", "128.0.0.1", "12.7.0.1", "arm.example", "127.arm.example",
                                "127.0.0.1.example", "127.1", ""}) {
    EXPECT_FALSE(is_on_this_computer(elsewhere)) << elsewhere;
  }
}

// A nervous second Ctrl-C does not take the arms their loop; one that comes later ends the program.
TEST(SignalWatch, ASecondSignalCountsAfterTwoSeconds) {
  for (const bool late : {false, true}) {
    const pid_t child = fork();
    ASSERT_GE(child, 0);
    if (child == 0) {
      int calls = 0;
      {
        const SignalWatch watch([&calls](int) { ++calls; });
        for (const int signal : {SIGINT, SIGINT, SIGTERM}) {
          kill(getpid(), signal);
          std::this_thread::sleep_for(std::chrono::milliseconds(20));
        }
        if (late) {
          std::this_thread::sleep_for(SignalWatch::kPatience);
          kill(getpid(), SIGTERM);
          std::this_thread::sleep_for(std::chrono::seconds(10));
        }
      }
      _exit(calls == 1 ? 0 : 1);
    }
    int status = 0;
    ASSERT_EQ(waitpid(child, &status, 0), child);
    ASSERT_TRUE(WIFEXITED(status));
    EXPECT_EQ(WEXITSTATUS(status), late ? 128 + SIGTERM : 0);
  }
}

// Nor does one that is pressed while the first is still handled, however long that takes.
TEST(SignalWatch, ASecondSignalDuringTheFirstIsIgnored) {
  const pid_t child = fork();
  ASSERT_GE(child, 0);
  if (child == 0) {
    int calls = 0;
    {
      const SignalWatch watch([&calls](int) {
        ++calls;
        kill(getpid(), SIGINT);
        std::this_thread::sleep_for(SignalWatch::kPatience);
      });
      kill(getpid(), SIGINT);
      std::this_thread::sleep_for(SignalWatch::kPatience + std::chrono::milliseconds(300));
    }
    _exit(calls == 1 ? 0 : 1);
  }
  int status = 0;
  ASSERT_EQ(waitpid(child, &status, 0), child);
  ASSERT_TRUE(WIFEXITED(status));
  EXPECT_EQ(WEXITSTATUS(status), 0);
}

class ChildProcessTest : public testing::Test {
 protected:
  void SetUp() override { std::filesystem::create_directories(folder); }
  void TearDown() override { std::filesystem::remove_all(folder); }
  ChildProcess::Options shell(const std::string& script) const {
    return {"/bin/sh", {"-c", script}, folder / "output", folder / "errors"};
  }
  const std::filesystem::path folder =
      std::filesystem::temp_directory_path() / ("child_process_" + std::to_string(getpid()));
};

TEST(RunProgram, ReturnsExitCodeAndOutput) {
  const ProgramResult good = run_program("/bin/echo", {"two words", "$HOME;"});  // no shell expands it
  EXPECT_TRUE(good.good());
  EXPECT_EQ(good.output, "two words $HOME;\n");
  EXPECT_EQ(run_program("/bin/sh", {"-c", "echo seen >&2; exit 3"}).exit_code, 3);
  EXPECT_EQ(run_program("/bin/sh", {"-c", "echo seen >&2; exit 3"}).output, "seen\n");
  const ProgramResult none = run_program("/nowhere/python", {});
  EXPECT_FALSE(none.good());
  EXPECT_THAT(none.reason, HasSubstr("/nowhere/python does not start"));
  EXPECT_THAT(run_program("/bin/sh", {"-c", "kill -9 $$"}).reason, HasSubstr("signal 9"));
}

TEST_F(ChildProcessTest, WritesToItsFilesAndReportsItsExitCode) {
  ChildProcess child(shell("echo out; echo err >&2; exit 4"));
  while (child.running()) std::this_thread::sleep_for(std::chrono::milliseconds(1));
  EXPECT_EQ(child.exit_code(), 4);
  EXPECT_EQ(child.output(), "out\n");
  EXPECT_EQ(child.errors(), "err\n");
}

TEST_F(ChildProcessTest, EndsWhenAskedAndIsKilledWhenItDoesNot) {
  ChildProcess obedient(shell("trap 'exit 5' TERM; echo ready; while :; do sleep 0.01; done"));
  while (obedient.output().empty()) std::this_thread::sleep_for(std::chrono::milliseconds(1));
  obedient.stop(std::chrono::seconds(10));
  EXPECT_EQ(obedient.exit_code(), 5);
  ChildProcess stubborn(shell("trap '' TERM; echo ready; while :; do sleep 0.01; done"));
  while (stubborn.output().empty()) std::this_thread::sleep_for(std::chrono::milliseconds(1));
  stubborn.stop(std::chrono::milliseconds(50));
  EXPECT_FALSE(stubborn.running());
  EXPECT_EQ(stubborn.exit_code(), -1);
}

TEST_F(ChildProcessTest, ThrowsWhenTheProgramDoesNotStart) {
  EXPECT_THROW(ChildProcess({"/nowhere/at/all", {}, folder / "output", folder / "errors"}),
               std::runtime_error);
  EXPECT_THROW(ChildProcess({"/bin/true", {}, folder / "none" / "output", folder / "errors"}),
               std::runtime_error);
}

TEST(Machine, DescribesWhatAMeasurementNeeds) {
  const auto info = describe_machine();
  for (const char* key : {"multipanda", "mujoco", "eigen", "compiler", "processor", "cores", "kernel"}) {
    EXPECT_TRUE(info.contains(key) && !info.at(key).empty()) << key;
  }
}

}  // namespace

namespace {

namespace fs = std::filesystem;

// These are programs of a build; tests/packages has installed ones.
class OwnFiles : public testing::Test {
 protected:
  void SetUp() override {
    unsetenv("MULTIPANDA_SHARE");
    unsetenv("MULTIPANDA_PYTHON");
  }
  void TearDown() override { SetUp(); }
};

TEST_F(OwnFiles, OfABuildAreTheSourceFolder) {
  EXPECT_EQ(share_folder(), fs::canonical(MULTIPANDA_SOURCE_DIR));
}

TEST_F(OwnFiles, AreWhereTheVariableSays) {
  setenv("MULTIPANDA_SHARE", "/somewhere", 1);
  EXPECT_EQ(share_folder(), "/somewhere");
  setenv("MULTIPANDA_SHARE", "", 1);  // as if it were not set
  EXPECT_EQ(share_folder(), fs::canonical(MULTIPANDA_SOURCE_DIR));
}

TEST_F(OwnFiles, PagesAreDrawnByTheBuildsEnvironment) {
  EXPECT_TRUE(fs::exists(page_python().parent_path().parent_path() / "pyvenv.cfg")) << page_python();
  EXPECT_EQ(page_packages_cure(), "run ./multipanda setup");
  setenv("MULTIPANDA_PYTHON", "/usr/bin/python9", 1);
  EXPECT_EQ(page_python(), "/usr/bin/python9");
}

TEST_F(OwnFiles, RobotDescriptionsComeFromTheBuildsEnvironment) {
  ASSERT_EQ(python_package_folders().size(), 1u);
  EXPECT_TRUE(fs::exists(python_package_folders().front() / "cmeel.prefix"))
      << python_package_folders().front();
}

}  // namespace

}  // namespace multipanda

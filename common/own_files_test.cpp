#include "common/own_files.hpp"

#include <cstdlib>
#include <filesystem>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace multipanda {
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

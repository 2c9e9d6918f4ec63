#include "logs/log_choice.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace multipanda::log_choice_test {
namespace {

TEST(LogEvery, TakesGroupsOneAfterTheOther) {
  LogEvery every;
  EXPECT_EQ(every.text(), "");
  every.set("all=100");
  every.set("state=1");
  every.set("timing=0");
  EXPECT_EQ(every.state, 1u);
  EXPECT_EQ(every.command, 100u);
  EXPECT_EQ(every.timing, 0u);
  EXPECT_EQ(every.model, 100u);
  EXPECT_EQ(every.text(),
            "command=100 wrench=100 references=100 outputs=100 timing=0 model=100 report=100 "
            "objects=100");
}

TEST(LogEvery, RefusesWhatItDoesNotUnderstandAndChangesNothing) {
  for (const char* wrong : {"", "state", "state=", "state=x", "state=1.5", "state=-1", "state=10 ",
                            "states=10", "=10", "state=99999999999999999999", "state=1000001"}) {
    LogEvery every;
    try {
      every.set(wrong);
      ADD_FAILURE() << wrong;
    } catch (const std::invalid_argument& error) {
      EXPECT_THAT(error.what(), testing::HasSubstr("groups: state, command, wrench")) << wrong;
    }
    EXPECT_EQ(every.text(), "") << wrong;
  }
}

TEST(EpisodeMarks, HaveTheNamesOfTheirKinds) {
  EXPECT_THAT(episode_marks(), testing::ElementsAre("start", "success", "failure", "discard"));
  EXPECT_EQ(to_string(EpisodeMark::Kind::discard), "discard");
}

}  // namespace
}  // namespace multipanda::log_choice_test

#include "cockpit/server/control.hpp"

#include <gtest/gtest.h>

namespace multipanda::cockpit::control_test {
namespace {

HostTime at(double s) { return HostTime::from_seconds(100 + s); }

TEST(Control, OneHolds) {
  Control control;
  EXPECT_TRUE(control.take(1, at(0)));
  EXPECT_TRUE(control.take(1, at(0)));
  EXPECT_FALSE(control.take(2, at(0)));
  EXPECT_FALSE(control.take(2, at(1)));
  EXPECT_EQ(control.requests().size(), 1u);
  EXPECT_TRUE(control.held_by(1));
}

TEST(Control, IsHandedOverByRequestOnly) {
  Control control;
  control.take(1, at(0));
  EXPECT_FALSE(control.give(2));
  control.take(2, at(0));
  control.take(3, at(0));
  EXPECT_TRUE(control.give(3));
  EXPECT_TRUE(control.held_by(3));
  EXPECT_EQ(control.requests().size(), 1u);
  control.keep();
  EXPECT_TRUE(control.requests().empty());
  EXPECT_FALSE(control.pass_on(at(100), false));
  EXPECT_TRUE(control.held_by(3));
}

TEST(Control, PassesOnWhenTheHolderLeavesOrIsSilent) {
  Control control;
  control.take(1, at(0));
  control.take(2, at(0));
  control.take(3, at(1));
  control.leave(1);
  EXPECT_TRUE(control.held_by(2));
  EXPECT_FALSE(control.pass_on(at(1 + Control::kPatience - 0.01), false));
  EXPECT_FALSE(control.pass_on(at(1 + Control::kPatience), true));  // it is moving an arm
  EXPECT_TRUE(control.held_by(2));
  EXPECT_TRUE(control.pass_on(at(1 + Control::kPatience), false));
  EXPECT_TRUE(control.held_by(3));
  control.leave(3);
  EXPECT_FALSE(control.holder());
}

TEST(Control, ForgetsWhoIsGone) {
  Control control;
  control.take(1, at(0));
  control.take(2, at(0));
  control.leave(2);
  control.give_up();
  EXPECT_FALSE(control.holder());
}

TEST(DeadMan, HoldsFromBeatToBeat) {
  DeadMan hold;
  EXPECT_FALSE(hold.begun());
  EXPECT_FALSE(hold.silent(at(0)));
  hold.beat(at(0));
  EXPECT_TRUE(hold.held(at(0.2)));
  EXPECT_FALSE(hold.silent(at(0.2)));
  EXPECT_FALSE(hold.held(at(0.201)));
  EXPECT_TRUE(hold.silent(at(0.201)));
  hold.beat(at(0.3));
  EXPECT_TRUE(hold.held(at(0.45)));
  hold.release();
  EXPECT_FALSE(hold.held(at(0.45)));
  EXPECT_FALSE(hold.silent(at(9)));
}

}  // namespace
}  // namespace multipanda::cockpit::control_test

#include "commission/person.hpp"

#include <memory>
#include <string>
#include <unistd.h>
#include <vector>

#include <gtest/gtest.h>

namespace multipanda::commission {
namespace {

// A person whose lines are already written; nobody is left behind them.
struct Written {
  int files[2]{-1, -1};
  std::vector<std::string> shown;
  std::unique_ptr<Person> person;

  explicit Written(const std::string& text, bool named = true) {
    EXPECT_EQ(pipe(files), 0);
    EXPECT_EQ(write(files[1], text.data(), text.size()), static_cast<ssize_t>(text.size()));
    close(files[1]);
    person = std::make_unique<Person>(
        Person::Options{.file = files[0],
                        .named = named,
                        .source = "the answers",
                        .show = [this](const std::string& id, const std::string&) { shown.push_back(id); },
                        .meanwhile = {}});
  }
  ~Written() { close(files[0]); }
  Person* operator->() const { return person.get(); }
};

TEST(Person, TakesNamedAnswersInOrder) {
  const Written written("# comment\n\nhold: go\nright: no\n weight.left :  0.75 \n");
  written->ready("hold", "?");
  EXPECT_FALSE(written->yes("right", "?"));
  EXPECT_DOUBLE_EQ(written->number("weight.left", "?", 0, 1.5), 0.75);
  EXPECT_EQ(written.shown, (std::vector<std::string>{"hold", "right", "weight.left"}));
}

TEST(Person, NothingIsAssumed) {
  EXPECT_THROW(Written("")->ready("hold", "?"), Ended);
  EXPECT_THROW(Written("hold:\n")->ready("hold", "?"), Ended);
  EXPECT_THROW(Written("hold: yes\n")->ready("hold", "?"), Ended);
  EXPECT_THROW(Written("guiding: go\n")->ready("hold", "?"), Ended);
  EXPECT_THROW(Written("go\n")->ready("hold", "?"), Ended);
  EXPECT_THROW(Written("hold: quit\n")->ready("hold", "?"), Ended);
  EXPECT_THROW(Written("right: go\n")->yes("right", "?"), Ended);
  EXPECT_THROW(Written("kg: 2\n")->number("kg", "?", 0, 1.5), Ended);
  EXPECT_THROW(Written("kg: nan\n")->number("kg", "?", 0, 1.5), Ended);
  EXPECT_THROW(Written("kg: 1x\n")->number("kg", "?", 0, 1.5), Ended);
  EXPECT_THROW(Written("hold: go")->ready("hold", "?"), Ended);  // no complete line
}

// On a terminal Enter is the key, an answer that is not understood is asked again, a closed one ends.
TEST(Person, ATerminalIsAskedAgain) {
  const Written written("maybe\n\nyes\nq\n", false);
  written->ready("hold", "?");
  EXPECT_TRUE(written->yes("right", "?"));
  EXPECT_THROW(written->ready("guiding", "?"), Ended);
  EXPECT_THROW(written->ready("guiding", "?"), Ended);
}

TEST(Person, GivesUpWhileWaiting) {
  int files[2];
  ASSERT_EQ(pipe(files), 0);
  Person person({.file = files[0],
                 .named = true,
                 .source = "the answers",
                 .show = [](const auto&, const auto&) {},
                 .meanwhile = {}});
  person.meanwhile([] { throw Ended("an arm left its hold"); });
  EXPECT_THROW(person.ready("hold", "?"), Ended);
  close(files[0]);
  close(files[1]);
}

}  // namespace
}  // namespace multipanda::commission

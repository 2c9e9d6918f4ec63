#include "common/person.hpp"

#include <chrono>
#include <memory>
#include <pty.h>
#include <string>
#include <thread>
#include <unistd.h>
#include <vector>

#include <gtest/gtest.h>

namespace multipanda::person_test {
namespace {

using Ended = Person::Ended;

// A person whose lines are already written; nobody is left behind them.
struct Written {
  int files[2]{-1, -1};
  std::vector<std::string> shown;
  std::unique_ptr<Person> person;

  explicit Written(const std::string& text, bool named = true, bool early = true) {
    EXPECT_EQ(pipe(files), 0);
    EXPECT_EQ(write(files[1], text.data(), text.size()), static_cast<ssize_t>(text.size()));
    close(files[1]);
    person = std::make_unique<Person>(
        Person::Options{.file = files[0],
                        .named = named,
                        .early = early,
                        .source = "the answers",
                        .show = [this](const std::string& id, const std::string&) { shown.push_back(id); }});
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

// With real arms nobody answers what was not asked yet; the end of a pipe is no answer.
TEST(Person, AnAnswerBeforeItsQuestionIsRefused) {
  EXPECT_NO_THROW(Written("hold: go\n")->ready("hold", "?"));
  const Written written("hold: go\n", true, false);
  EXPECT_THROW(written->ready("hold", "?"), Ended);
  EXPECT_TRUE(written.shown.empty());
  int files[2];
  ASSERT_EQ(pipe(files), 0);
  const auto say = [&](const auto& id, const auto&) {
    const std::string line = id + ": go\n";
    EXPECT_EQ(write(files[1], line.data(), line.size()), static_cast<ssize_t>(line.size()));
  };
  Person person({.file = files[0], .named = true, .source = "the answers", .show = say});
  EXPECT_NO_THROW(person.ready("hold", "?"));
  EXPECT_NO_THROW(person.ready("guiding", "?"));
  const std::string two = "a: go\nb: go\n";
  ASSERT_EQ(write(files[1], two.data(), two.size()), static_cast<ssize_t>(two.size()));
  EXPECT_THROW(person.ready("a", "?"), Ended);
  close(files[0]);
  close(files[1]);
}

// A bouncing or kept key: pressed at every look until a pause, then "quit". None of the first answers.
TEST(Person, AKeyThatBouncesOnATerminalAnswersNothing) {
  int master = -1, terminal = -1;
  ASSERT_EQ(openpty(&master, &terminal, nullptr, nullptr, nullptr), 0);
  const auto press = [&](const std::string& keys) {
    EXPECT_EQ(write(master, keys.data(), keys.size()), static_cast<ssize_t>(keys.size()));
  };
  int looks = 0;
  std::thread hand;
  Person person(
      {.file = terminal, .named = false, .source = "the terminal", .show = [&](const auto&, const auto&) {
         press("\n");
       }});
  person.meanwhile([&] {
    if (++looks == 1) {
      hand = std::thread([&] {
        for (int k = 0; k < 5; ++k) {
          std::this_thread::sleep_for(std::chrono::milliseconds(50));
          press("\n");
        }
        std::this_thread::sleep_for(std::chrono::milliseconds(1500));
        press("quit\n");
      });
    }
  });
  EXPECT_THROW(person.ready("joint_motion.left", "?"), Ended);
  hand.join();
  close(master);
  close(terminal);
}

TEST(Person, GivesUpWhileWaiting) {
  int files[2];
  ASSERT_EQ(pipe(files), 0);
  Person person(
      {.file = files[0], .named = true, .source = "the answers", .show = [](const auto&, const auto&) {}});
  person.meanwhile([] { throw Ended("an arm left its hold"); });
  EXPECT_THROW(person.ready("hold", "?"), Ended);
  close(files[0]);
  close(files[1]);
}

}  // namespace
}  // namespace multipanda::person_test

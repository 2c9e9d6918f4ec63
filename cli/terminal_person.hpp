#pragma once

#include "cli/console.hpp"
#include "experiments/person.hpp"

namespace multipanda::cli {

// A person at the terminal: Enter alone means yes, q and Enter or the end of the input mean stop. Keys
// pressed before the prompt do not count; it appears after a second without any.
class TerminalPerson final : public Person {
 public:
  explicit TerminalPerson(const Console& console) : console_(console) {}

  static bool present();  // standard input is a terminal, and this program is in its foreground
  bool confirm(const Question& question, const std::function<bool()>& withdrawn) override;

 private:
  const Console& console_;
};

}  // namespace multipanda::cli

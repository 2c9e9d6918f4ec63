#pragma once

#include <cstdio>
#include <string>

namespace multipanda::cli {

// Where words for people go: standard output, or standard error when that belongs to a machine (--json).
class Console {
 public:
  explicit Console(bool json);

  bool is_terminal() const { return terminal_; }  // that can be drawn on
  bool has_colour() const { return colour_; }     // a terminal, and NO_COLOR is not set
  std::size_t width() const;                      // columns, now
  std::size_t height() const;                     // lines, now

  void line(const std::string& text) const;  // with a newline, at once
  void raw(const std::string& text) const;   // as it is, in one piece, at once

 private:
  std::FILE* stream_;
  bool terminal_ = false, colour_ = false;
};

}  // namespace multipanda::cli

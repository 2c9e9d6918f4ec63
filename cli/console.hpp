#pragma once

#include <cstdio>
#include <string>

namespace multipanda::cli {

// Human-readable output: standard output, or standard error if standard output carries JSON (--json).
class Console {
 public:
  explicit Console(bool json);

  bool is_terminal() const { return terminal_; }  // supports redrawing
  bool has_color() const { return color_; }       // a terminal, and NO_COLOR is not set
  std::size_t width() const;                      // current number of columns
  std::size_t height() const;                     // current number of lines

  void line(const std::string& text) const;  // with a newline; flushed
  void raw(const std::string& text) const;   // unchanged, in one write; flushed

 private:
  std::FILE* stream_;
  bool terminal_ = false, color_ = false;
};

}  // namespace multipanda::cli

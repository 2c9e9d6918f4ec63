#pragma once

#include <stdexcept>
#include <string>

namespace multipanda::fci {

// What a call to an arm (or gripper) came to, where it did not succeed. The text names the arm, says what
// happened and what to do; `kind` is for programs.
class LinkError : public std::runtime_error {
 public:
  enum class Kind {
    unreachable,   // no connection could be made
    lost,          // the connection is gone; connect again
    timeout,       // no answer in time; the connection was closed, since a late answer would confuse
    protocol,      // bytes that no arm of this version sends; the connection was closed
    incompatible,  // the arm speaks a version that is not spoken here
    refused,       // the arm answered no
    aborted        // a motion ended otherwise than it was meant to
  };

  LinkError(Kind kind, const std::string& text) : std::runtime_error(text), kind_(kind) {}
  Kind kind() const { return kind_; }
  // The connection is of no more use.
  bool is_fatal() const { return kind_ != Kind::refused && kind_ != Kind::aborted; }

 private:
  Kind kind_;
};

}  // namespace multipanda::fci

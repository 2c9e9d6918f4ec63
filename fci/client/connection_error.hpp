#pragma once

#include <stdexcept>
#include <string>

namespace multipanda::fci {

// A call to an arm or gripper that failed. The text names the arm, the cause and the remedy; `kind`
// is for programs.
class ConnectionError : public std::runtime_error {
 public:
  enum class Kind {
    unreachable,  // no connection could be made
    lost,         // the connection is lost; reconnect
    timeout,      // no answer in time; the connection was closed, because a late answer could be mistaken for
                  // another
    protocol,     // invalid bytes for this version; the connection was closed
    incompatible,  // protocol version not supported
    refused,       // the arm refused
    aborted        // a motion ended otherwise than commanded
  };

  ConnectionError(Kind kind, const std::string& text) : std::runtime_error(text), kind_(kind) {}
  Kind kind() const { return kind_; }
  // The connection cannot be used any longer.
  bool is_fatal() const { return kind_ != Kind::refused && kind_ != Kind::aborted; }

 private:
  Kind kind_;
};

}  // namespace multipanda::fci

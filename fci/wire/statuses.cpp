#include "fci/wire/statuses.hpp"

namespace multipanda::fci {

std::string_view text(Status status) {
  switch (status) {
    case Status::success:
      return "done";
    case Status::motion_started:
      return "motion started";
    case Status::preempted:
      return "motion stopped on request";
    case Status::preempted_by_safety:
      return "motion stopped by a safety function";
    case Status::rejected_by_safety:
      return "rejected: a safety function is active";
    case Status::not_possible:
      return "rejected: not possible in the arm's current mode";
    case Status::singular:
      return "rejected: the motion would begin at a singular pose";
    case Status::invalid_argument:
      return "rejected: invalid argument";
    case Status::reflex_aborted:
      return "stopped by a reflex";
    case Status::emergency_aborted:
      return "stopped by the user stop";
    case Status::input_error_aborted:
      return "stopped: a command was invalid";
    case Status::aborted:
      return "aborted";
    case Status::manual_recovery_required:
      return "rejected: the arm must be moved by hand first";
    case Status::incompatible_version:
      return "the arm uses a different version of the protocol";
    case Status::error:
      return "the arm has no model for this computer";
  }
  return "unknown status";
}

}  // namespace multipanda::fci

#pragma once

#include <string>

#include "cli/console.hpp"
#include "runtime/session.hpp"

namespace multipanda::cli {

// Runs a session to its end, showing it on the console. Ctrl-C, SIGTERM and a closed terminal end it in hold;
// a second one ends the process at once.
RunSummary run_session(Session& session, const Console& console);

// What a run was, for people.
void print_summary(const RunSummary& summary, const Console& console);
// Per switch: when, what, how long, how large the torque step.
void print_switches(const RunSummary& summary, const Console& console);

}  // namespace multipanda::cli

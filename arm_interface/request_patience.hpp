#pragma once

namespace multipanda {

// A backend starts to execute a request to an arm within this time, or refuses it: the caller may have given
// up by then, and nothing may move after it was told of a failure.
inline constexpr double kRequestPatience = 5;  // [s]
// Additional waiting time of the caller. By then the request has either been started, with its end unknown,
// or it waits behind another one and will be refused.
inline constexpr double kRequestSlack = 0.5;  // [s]

inline constexpr const char* kRequestTooOld =
    "the request is too old, or its sender no longer waits, and it was not executed: send it again";
inline constexpr const char* kRequestUnfinished =
    "the arm has not finished the request: it may still be executed; check the arm before you try again";

}  // namespace multipanda

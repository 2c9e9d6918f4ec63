#pragma once

namespace multipanda {

// A backend begins to carry out a request to an arm within this time, or refuses it: whoever asked may have
// given up by then, and nothing may move after its asker was told that it failed.
inline constexpr double kRequestPatience = 5;  // [s]
// The asker waits so much longer. By then the request was begun, and its end is not known yet; or it waits
// behind another one and is refused when its turn comes.
inline constexpr double kRequestSlack = 0.5;  // [s]

inline constexpr const char* kRequestTooOld =
    "it waited for more than 5 s behind another request and was not executed: ask again";
inline constexpr const char* kRequestUnfinished =
    "the arm has not finished the request: it may still be carried out; look at the arm before asking again";

}  // namespace multipanda

#pragma once

#include <cstdint>

#include "motion_generators/circular_field/course.hpp"

namespace multipanda::circular_field {

// A course drawn from a seed, for tests and trials: two hands of radius 0.08 m in the shared workspace of a
// pair of arms, each with a goal at least 0.3 m away, and `obstacles` balls of 0.04 to 0.08 m that swing or
// drift at 0.02 to 0.1 m/s. Hands and obstacles are apart at the start, and so are the two goals; obstacles
// may pass over starts and goals. A goal that obstacles never leave free for three
// seconds between 3 and 20 s is unreachable and is drawn again.
Course seeded_course(std::uint32_t seed, std::size_t obstacles = 5);

}  // namespace multipanda::circular_field

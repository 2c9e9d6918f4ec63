#pragma once

#include <vector>

#include "sysid/identification/filtered_log.hpp"

namespace multipanda {

// Period of a motion that repeats itself, in kept rows; 0: it does not. A block left out of a fit says
// nothing about new motion if the same motion is in another block.
Eigen::Index repeated_after(const FilteredLog& log);

// A stretch of kept rows, and the block that it belongs to.
struct BlockRange {
  std::size_t block = 0;
  Eigen::Index begin = 0, end = 0;  // kept rows
};

// The log cut into `blocks` parts by time; a motion that repeats itself by its phase, so that no part has
// motion of another one.
std::vector<BlockRange> block_ranges(const FilteredLog& log, std::size_t blocks);

}  // namespace multipanda

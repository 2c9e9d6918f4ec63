#pragma once

#include "core/testing/test_world.hpp"

namespace multipanda::test {

// The laws of test_laws.hpp on four arms.
inline std::vector<InstanceConfig> four_arms() {
  return {
      {.name = "s0", .type = "spring", .arms = {0}},      {.name = "s1", .type = "spring", .arms = {1}},
      {.name = "s2", .type = "spring", .arms = {2}},      {.name = "s3", .type = "spring", .arms = {3}},
      {.name = "p12", .type = "pair", .arms = {1, 2}},    {.name = "p31", .type = "pair", .arms = {3, 1}},
      {.name = "f2", .type = "follow", .arms = {2}},      {.name = "refuser", .type = "refuser", .arms = {1}},
      {.name = "thrower", .type = "thrower", .arms = {2}}};
}

}  // namespace multipanda::test

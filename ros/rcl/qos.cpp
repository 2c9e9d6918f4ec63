#include "ros/rcl/qos.hpp"

#include <rmw/qos_profiles.h>

namespace multipanda::ros {

rmw_qos_profile_t Qos::profile() const {
  rmw_qos_profile_t profile = rmw_qos_profile_default;
  profile.history = RMW_QOS_POLICY_HISTORY_KEEP_LAST;
  profile.depth = depth;
  profile.reliability = reliability == Reliability::reliable ? RMW_QOS_POLICY_RELIABILITY_RELIABLE
                                                             : RMW_QOS_POLICY_RELIABILITY_BEST_EFFORT;
  profile.durability =
      transient_local ? RMW_QOS_POLICY_DURABILITY_TRANSIENT_LOCAL : RMW_QOS_POLICY_DURABILITY_VOLATILE;
  return profile;
}

std::string Qos::text() const {
  std::string text = reliability == Reliability::reliable ? "reliable" : "best effort";
  text += ", newest " + std::to_string(depth);
  if (transient_local) text += ", kept for late subscribers";
  return text;
}

}  // namespace multipanda::ros

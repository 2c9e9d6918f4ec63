#pragma once

#include <vector>

#include "scene/fields.hpp"

// Every key of a scene file, as tables. What is written here is what is read, checked and documented.
namespace multipanda::schema {

const Section& scene();
const Section& plant();
const Section& arm();
const Section& pose();
const Section& load();
const Section& inertia();
const Section& safety();
const Section& fci();
const Section& collision();
const Section& thresholds();
const Section& object();
const Section& tool_shape();
const Section& contact();
const Section& controllet();
const Section& pose_input();    // overrides of an input of quantity pose
const Section& joints_input();  // ... joints
const Section& other_input();   // ... twist, wrench, scalar
const Section& event();
const Section& switch_event();
const Section& parameter_event();
const Section& feature_event();
const Section& reference_event();
const Section& motion_event();
const Section& overtone();
const Section& place_event();
const Section& ros();
const Section& ros_rates();

// In the order of the documentation.
std::vector<const Section*> all();

}  // namespace multipanda::schema

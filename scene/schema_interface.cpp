#include "scene/schema.hpp"

// The keys about the arm itself and the way to it.
namespace multipanda::schema {

const Section& fci() {
  static const Section section{
      "FCI",
      "A real arm, reached over the Franka Control Interface. A virtual one looks the same from here.",
      {{.key = "address",
        .kind = FieldKind::text,
        .fallback = "172.16.0.2",
        .doc = "IPv4 address or host name. `fci: 172.16.0.2` says the same."},
       {.key = "version",
        .kind = FieldKind::choice,
        .fallback = "auto",
        .choices = {"auto", "4", "5", "6", "7", "8", "9", "10"},
        .doc = "Of the control interface; `auto`: whichever the arm speaks."},
       {.key = "gripper",
        .kind = FieldKind::boolean,
        .fallback = "true",
        .doc = "Connect to the hand's gripper. Without one the arm runs all the same."},
       {.key = "vacuum",
        .kind = FieldKind::boolean,
        .fallback = "false",
        .doc = "Connect to a vacuum gripper."},
       {.key = "low_pass_hz",
        .kind = FieldKind::number,
        .unit = "Hz",
        .fallback = "0",
        .min = 0,
        .max = 1000,
        .doc = "Low-pass on the commanded torques; 0: none."},
       {.key = "rate_limit",
        .kind = FieldKind::boolean,
        .fallback = "false",
        .doc = "Keep commanded torques within the rate that the arm allows. The safety stage does so anyway, "
               "unless it was loosened."},
       {.key = "check_model",
        .kind = FieldKind::boolean,
        .fallback = "true",
        .doc = "Compare the arm's own robot model with ours before the start, where the arm delivers one."}}};
  return section;
}

namespace {

std::vector<Field> threshold_fields() {
  const auto torque = [](std::string key, std::string what) {
    return Field{.key = std::move(key),
                 .kind = FieldKind::numbers,
                 .unit = "N m",
                 .min = 0.001,
                 .max = 1000,
                 .count = Field::kPerJoint,
                 .doc = std::move(what)};
  };
  const auto wrench = [](std::string key, std::string what) {
    return Field{.key = std::move(key),
                 .kind = FieldKind::numbers,
                 .unit = "N, N m",
                 .min = 0.001,
                 .max = 1000,
                 .count = 6,
                 .doc = std::move(what)};
  };
  return {
      torque("torque_lower_nm", "External torque above which a joint reports contact. Without it as upper."),
      torque("torque_upper_nm",
             "Above which the arm stops with a reflex. Without it the joint's largest torque."),
      wrench("wrench_lower",
             "External force and torque at K (x, y, z, roll, pitch, yaw) above which contact is reported. "
             "Without it as upper."),
      wrench("wrench_upper", "Above which the arm stops with a reflex. Without it 100 each.")};
}

}  // namespace

const Section& thresholds() {
  static const Section section{
      "Thresholds", "While the arm accelerates. What is left out is as in Collision.", threshold_fields()};
  return section;
}

const Section& collision() {
  static const Section section = [] {
    Section made{"Collision",
                 "When the arm itself reports contact and when it stops, real or simulated. A list has one "
                 "number per joint or axis; a single number holds for all.",
                 threshold_fields()};
    made.fields.push_back({.key = "acceleration",
                           .kind = FieldKind::section,
                           .section = &thresholds(),
                           .doc = "Other thresholds while the arm accelerates. Without it the same."});
    return made;
  }();
  return section;
}

}  // namespace multipanda::schema

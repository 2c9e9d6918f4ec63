#pragma once

// What differs between the lines of ros2_control: Humble (2), Jazzy (4), Kilted (5) and later. Nothing else
// in this package asks for a version.
#include <controller_interface/controller_interface.hpp>
#include <string>
#include <type_traits>
#include <utility>

namespace multipanda_controller::compat {

// A loaned state interface's number; false: another thread holds it just now, `value` stays.
template <class Interface>
bool read(const Interface& interface, double& value) {
  if constexpr (requires { interface.get_optional(); }) {
    const auto now = interface.get_optional();
    if (!now) return false;
    value = *now;
  } else {
    value = interface.get_value();
  }
  return true;
}

// Humble's answers nothing.
template <class Interface>
bool write(Interface& interface, double value) {
  if constexpr (std::is_void_v<decltype(interface.set_value(value))>) {
    interface.set_value(value);
    return true;
  } else {
    return interface.set_value(value);
  }
}

// Empty where the line does not hand it to controllers.
template <class Controller>
std::string robot_description(const Controller& controller) {
  if constexpr (requires { controller.get_robot_description(); }) {
    return controller.get_robot_description();
  } else {
    return {};
  }
}

template <class Controller>
bool is_async(const Controller& controller) {
  if constexpr (requires { controller.is_async(); }) {
    return controller.is_async();
  } else {
    return false;
  }
}

}  // namespace multipanda_controller::compat

#pragma once

// Differences between the versions of ros2_control: Humble (2), Jazzy (4), Kilted (5) and later. Only this
// file of the package depends on the version.
#include <controller_interface/controller_interface.hpp>
#include <string>
#include <type_traits>
#include <utility>

namespace multipanda_controller::compat {

// Reads the number of a loaned state interface. Returns false, and leaves `value` unchanged, if another
// thread holds it.
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

// Humble's version returns nothing.
template <class Interface>
bool write(Interface& interface, double value) {
  if constexpr (std::is_void_v<decltype(interface.set_value(value))>) {
    interface.set_value(value);
    return true;
  } else {
    return interface.set_value(value);
  }
}

// Empty if this version does not pass it to controllers.
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

#pragma once

// Differences between the versions of ros2_control: Humble (2), Jazzy (4), Kilted (5) and later. Only this
// file of the package depends on the version.

// Headers of some versions use the first two without including them, so the order matters.
// clang-format off
#include <cxxabi.h>
#include <rclcpp/rclcpp.hpp>
#include <hardware_interface/system_interface.hpp>
// clang-format on

#if __has_include(<hardware_interface/types/hardware_component_interface_params.hpp>)
#include <hardware_interface/types/hardware_component_interface_params.hpp>
namespace multipanda_hardware::compat {
using InitArgument = hardware_interface::HardwareComponentInterfaceParams;
}
#else
namespace multipanda_hardware::compat {
using InitArgument = hardware_interface::HardwareInfo;
}
#endif

// All versions can export interfaces that point at our numbers, by a function that newer versions deprecate.
#define MULTIPANDA_HARDWARE_BEGIN_DEPRECATED \
  _Pragma("GCC diagnostic push") _Pragma("GCC diagnostic ignored \"-Wdeprecated-declarations\"")
#define MULTIPANDA_HARDWARE_END_DEPRECATED _Pragma("GCC diagnostic pop")

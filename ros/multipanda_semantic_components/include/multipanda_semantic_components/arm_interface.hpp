#pragma once

#include <hardware_interface/loaned_state_interface.hpp>
#include <string>
#include <vector>

#include "ros/host/arm_view.hpp"

namespace multipanda_semantic_components {

// A state interface that carries an arm's address. Pass get_state_interface_names() to the controller's
// state_interface_configuration(), assign in on_activate, release in on_deactivate.
class ArmInterface {
 public:
  ArmInterface(const std::string& arm, const std::string& kind) : name_(arm + "/" + kind) {}

  std::vector<std::string> get_state_interface_names() const { return {name_}; }

  // Returns false if the interface is missing or belongs to other hardware.
  bool assign_loaned_state_interfaces(std::vector<hardware_interface::LoanedStateInterface>& interfaces) {
    for (auto& interface : interfaces) {
      if (interface.get_name() == name_) interface_ = &interface;
    }
    return interface_ != nullptr && static_cast<bool>(view());
  }
  void release_interfaces() { interface_ = nullptr; }

 protected:
  // Resolved at each call, because the hardware withdraws its address before it is destroyed.
  multipanda::ros::ArmView view() const {
    return interface_ == nullptr ? multipanda::ros::ArmView() : behind(*interface_);
  }

 private:
  // Newer versions return an optional, older ones the number.
  template <class Interface>
  static multipanda::ros::ArmView behind(const Interface& interface) {
    if constexpr (requires { interface.get_optional(); }) {
      const auto value = interface.get_optional();
      return value ? multipanda::ros::ArmView::from_interface(*value) : multipanda::ros::ArmView();
    } else {
      return multipanda::ros::ArmView::from_interface(interface.get_value());
    }
  }

  std::string name_;
  hardware_interface::LoanedStateInterface* interface_ = nullptr;
};

}  // namespace multipanda_semantic_components

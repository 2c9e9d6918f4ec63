#pragma once

#include <hardware_interface/loaned_state_interface.hpp>
#include <string>
#include <vector>

#include "ros/host/arm_view.hpp"

namespace multipanda_semantic_components {

// One state interface that carries an arm's address. Use: give get_state_interface_names() to the
// controller's state_interface_configuration(), assign in on_activate, release in on_deactivate.
class ArmInterface {
 public:
  ArmInterface(const std::string& arm, const std::string& kind) : name_(arm + "/" + kind) {}

  std::vector<std::string> get_state_interface_names() const { return {name_}; }

  // False: the interface is not among them, or another kind of hardware stands behind it.
  bool assign_loaned_state_interfaces(std::vector<hardware_interface::LoanedStateInterface>& interfaces) {
    for (auto& interface : interfaces) {
      if (interface.get_name() == name_) interface_ = &interface;
    }
    return interface_ != nullptr && static_cast<bool>(view());
  }
  void release_interfaces() { interface_ = nullptr; }

 protected:
  // Looked up anew each time: the hardware takes its address back before it goes.
  multipanda::ros::ArmView view() const {
    return interface_ == nullptr ? multipanda::ros::ArmView() : behind(*interface_);
  }

 private:
  // The newer lines answer with an optional, the older with the number.
  template <class Interface>
  static multipanda::ros::ArmView behind(const Interface& interface) {
    if constexpr (requires { interface.get_optional(); }) {
      const auto value = interface.get_optional();
      return value ? multipanda::ros::ArmView::behind(*value) : multipanda::ros::ArmView();
    } else {
      return multipanda::ros::ArmView::behind(interface.get_value());
    }
  }

  std::string name_;
  hardware_interface::LoanedStateInterface* interface_ = nullptr;
};

}  // namespace multipanda_semantic_components

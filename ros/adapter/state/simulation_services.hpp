#pragma once

#include <multipanda_msgs/srv/place_objects.hpp>
#include <multipanda_msgs/srv/step_simulation.hpp>
#include <std_srvs/srv/set_bool.hpp>
#include <std_srvs/srv/trigger.hpp>

#include "ros/adapter/part.hpp"
#include "ros/rcl/rcl.hpp"

namespace multipanda::ros {

// simulation/{reset, pause, step, place_objects}: of the world that the simulated arms share.
class SimulationServices : public Part {
 public:
  SimulationServices(const AdapterWorld& world, ArmIndex simulated_arm);

 private:
  using Answered = std::function<void(const std::vector<ArmAnswer>&)>;
  // Asks for all of them in one cycle and calls `answered` on the executor's thread when all have an answer,
  // at the latest after `patience_s`.
  void ask(std::vector<ArmRequest> requests, double patience_s, Answered answered);
  void place(const multipanda_msgs::srv::PlaceObjects::Request& request,
             const Service<multipanda_msgs::srv::PlaceObjects>::Reply& reply);
  void count(bool success) const;

  const AdapterWorld& world_;
  ArmIndex arm_;
  Service<std_srvs::srv::Trigger> reset_;
  Service<std_srvs::srv::SetBool> pause_;
  Service<multipanda_msgs::srv::StepSimulation> step_;
  Service<multipanda_msgs::srv::PlaceObjects> place_;
};

// Where the objects of a request are to stand, in the world. Throws std::invalid_argument: sizes, frames,
// numbers.
std::vector<PlaceObject> placements(const multipanda_msgs::srv::PlaceObjects::Request& request,
                                    const std::vector<std::pair<std::string, Pose>>& bases);

}  // namespace multipanda::ros

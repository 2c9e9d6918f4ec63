#pragma once

#include <multipanda_msgs/srv/place_objects.hpp>
#include <multipanda_msgs/srv/step_simulation.hpp>
#include <std_srvs/srv/set_bool.hpp>
#include <std_srvs/srv/trigger.hpp>

#include "ros/adapter/adapter_part.hpp"
#include "ros/rcl/rcl.hpp"

namespace multipanda::ros {

// simulation/{reset, pause, step, place_objects}, for the world of the simulated arms.
class SimulationServices : public AdapterPart {
 public:
  explicit SimulationServices(const AdapterContext& run);

 private:
  using Answered = std::function<void(const std::vector<RequestAnswer>&)>;
  // Sends all requests in one cycle and calls `answered` on the executor's thread when all are answered, at
  // the latest after `timeout_s`.
  void send(std::vector<WorldRequest> requests, double timeout_s, Answered answered);
  void place(const multipanda_msgs::srv::PlaceObjects::Request& request,
             const Service<multipanda_msgs::srv::PlaceObjects>::Reply& reply);

  const AdapterContext& run_;
  Service<std_srvs::srv::Trigger> reset_;
  Service<std_srvs::srv::SetBool> pause_;
  Service<multipanda_msgs::srv::StepSimulation> step_;
  Service<multipanda_msgs::srv::PlaceObjects> place_;
};

// Returns the requested poses of objects. Throws std::invalid_argument for wrong sizes, frames or numbers.
std::vector<PlaceObject> placements(const multipanda_msgs::srv::PlaceObjects::Request& request,
                                    const std::vector<std::pair<std::string, Pose>>& bases);

}  // namespace multipanda::ros

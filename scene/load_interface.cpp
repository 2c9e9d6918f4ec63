#include <algorithm>
#include <arpa/inet.h>
#include <cctype>
#include <cstdlib>

#include "common/text.hpp"
#include "scene/load_parts.hpp"

namespace multipanda {
namespace {

bool is_address(const std::string& text) {
  constexpr std::size_t kLongest = 253;  // of a host name
  if (text.empty() || text.size() > kLongest) return false;
  const auto is_one_of = [&](const char* others, auto kind) {
    return std::all_of(text.begin(), text.end(), [&](char c) {
      return kind(static_cast<unsigned char>(c)) != 0 ||
             std::string_view(others).find(c) != std::string_view::npos;
    });
  };
  in_addr ignored{};
  if (is_one_of(".", [](int c) { return std::isdigit(c); }))
    return inet_pton(AF_INET, text.c_str(), &ignored) == 1;
  return is_one_of(".-_", [](int c) { return std::isalnum(c); }) && text.front() != '-' &&
         text.front() != '.';
}

void check_order(const Archive& archive, const std::string& lower_key, const std::string& upper_key,
                 const Eigen::VectorXd& lower, const Eigen::VectorXd& upper, const char* place) {
  for (Eigen::Index i = 0; i < lower.size(); ++i) {
    if (lower[i] <= upper[i]) continue;
    archive.at(archive.has(lower_key) ? lower_key : upper_key)
        .refuse(std::string(place) + std::to_string(i + 1) + ": expected " + lower_key + " at most " +
                upper_key + ", found " + number_text(lower[i]) + " and " + number_text(upper[i]));
  }
}

// `t` holds the defaults; those of lower thresholds never exceed the upper ones.
void visit_thresholds(Archive& archive, ContactThresholds& t) {
  const auto n = static_cast<std::size_t>(t.torque_upper.size());
  const auto torque = [&](const char* name, const char* doc, JointVector& value) {
    archive(Key(name, doc).within(0.001, 1000).joints(n).or_one().no_default(), value);
  };
  const auto wrench = [&](const char* name, const char* doc, Vector6& value) {
    archive(Key(name, doc).in("N, N m").within(0.001, 1000).or_one().no_default(), value);
  };
  const ContactThresholds absent = t;
  torque("torque_lower_nm", "External torque above which a joint reports contact. Default: torque_upper_nm.",
         t.torque_lower);
  torque("torque_upper_nm",
         "External torque above which the arm stops with a reflex. Default: the joint's largest torque.",
         t.torque_upper);
  wrench("wrench_lower",
         "External force and torque at K (x, y, z, roll, pitch, yaw) above which contact is reported. "
         "Default: wrench_upper.",
         t.wrench_lower);
  wrench("wrench_upper",
         "External force and torque at K above which the arm stops with a reflex. Default: 100 each.",
         t.wrench_upper);
  if (!archive.reading()) return;
  if (!archive.has("torque_lower_nm")) t.torque_lower = absent.torque_lower.cwiseMin(t.torque_upper);
  if (!archive.has("wrench_lower")) t.wrench_lower = absent.wrench_lower.cwiseMin(t.wrench_upper);
  check_order(archive, "torque_lower_nm", "torque_upper_nm", t.torque_lower, t.torque_upper, "joint");
  check_order(archive, "wrench_lower", "wrench_upper", t.wrench_lower, t.wrench_upper, "axis ");
}

}  // namespace

void visit(Archive& archive, SetCollisionThresholds& collision, const RobotDescription& robot) {
  archive.about(
      "Collision",
      "When the arm itself reports contact and when it stops, real or simulated. A list has one number "
      "per joint or axis; a single number applies to all.");
  const Vector6 wrench = Vector6::Constant(100);  // [N, N m]
  collision.nominal = {robot.limits.tau_max, robot.limits.tau_max, wrench, wrench};
  visit_thresholds(archive, collision.nominal);
  ContactThresholds accelerating = collision.nominal;
  archive.part(Key("acceleration", "Thresholds while the arm accelerates. Default: the same."),
               [&](Archive& inner) {
                 inner.about("Thresholds", "While the arm accelerates. Missing keys are as in Collision.");
                 visit_thresholds(inner, accelerating);
               });
  if (archive.has("acceleration")) collision.acceleration = accelerating;
}

void visit(Archive& archive, SceneForceSensor& sensor) {
  archive.about(
      "Force sensor",
      "Between flange and tool, in place of estimated forces (docs/forces.md): simulated, or an ATI "
      "Net F/T at a real arm. S is its frame.");
  visit_pose(archive, sensor.mount.X_FS, Key("position_m", "S in the flange."));
  archive.section(
      Key("carries", "All that the sensor carries besides the declared payload. Default: hand and tool."),
      sensor.carried);
  archive(Key("range_n", "Beyond it, in an axis, the sensor is saturated.").within(1, 10000),
          sensor.mount.range_n);
  archive(Key("range_nm", "The same for moments.").within(0.1, 1000), sensor.mount.range_nm);
  archive(
      Key("max_age_s", "A law that needs the force ends when the last record is older.").within(0.002, 0.03),
      sensor.mount.max_age_s);
  archive(Key("address", "IPv4 address or host name of a real one."), sensor.address);
  archive(
      Key("counts_per_n", "As its own page shows them, with N and N m as its units. Required at a real arm.")
          .in("1/N")
          .within(1, 1e9),
      sensor.counts_per_n);
  archive(Key("counts_per_nm", "The same for moments.").in("1/(N m)").within(1, 1e9), sensor.counts_per_nm);
  sensor.has_counts = archive.has("counts_per_n") && archive.has("counts_per_nm");
  if (archive.reading() && !is_address(sensor.address))
    archive.at("address").expected("an IPv4 address or a host name, for example 192.168.1.1");
}

void check_address(const Node& address, const FciConnection& fci, const SceneReader& reader) {
  if (!is_address(fci.address)) address.expected("an IPv4 address or a host name, for example 172.16.0.2");
  for (const auto& other : reader.scene.arms) {
    if (other.fci && other.fci->address == fci.address) {
      address.refuse("arm '" + other.name + "' has the same address " + fci.address +
                     "; expected an address of its own for every arm");
    }
  }
}

void visit(Archive& archive, FciConnection& fci, SceneReader& reader) {
  archive.about("FCI",
                "A real arm, reached over the Franka Control Interface. A virtual arm is reached in the same "
                "way.");
  archive(Key("address", "IPv4 address or host name. `fci: 172.16.0.2` is the short form."), fci.address);
  std::string version = "auto";
  archive(
      Key("version",
          "Version of the control interface, also of the arm's virtual arm; `auto`: the version of the arm.")
          .one_of({"auto", "4", "5", "6", "7", "8", "9", "10"}),
      version);
  fci.version = version == "auto" ? 0 : std::atoi(version.c_str());
  archive(Key("gripper", "Connect to the gripper of the hand. The arm also runs without one."), fci.gripper);
  archive(Key("vacuum", "Connect to a vacuum gripper."), fci.vacuum);
  archive(Key("robotiq",
              "Serial port of a Robotiq 2F gripper at this computer, in place of the hand (`hand: false`), "
              "such as "
              "/dev/serial/by-id/usb-FTDI_..."),
          fci.robotiq);
  archive(Key("robotiq_model", "Its stroke, speeds and forces.").one_of({"2f-85", "2f-140"}),
          fci.robotiq_model);
  archive(
      Key("low_pass_hz", "Cutoff frequency of a low-pass on the commanded torques; 0: none.").within(0, 1000),
      fci.low_pass_hz);
  archive(
      Key("check_model",
          "Before the start, compare the robot model that the arm provides, if any, with the scene's model."),
      fci.check_model);
  archive(Key("recover_at_start",
              "Clear a reflex in which the arm is found at the start or at a reconnection. Otherwise `ctl "
              "recover` does."),
          fci.recover_at_start);
  archive(Key("keep_collision_thresholds",
              "Without the arm's key `collision`, leave the thresholds that an earlier program has set. "
              "Otherwise the arm gets careful ones: 80 N, 25 N m, and 40 N m or less per joint."),
          fci.keep_collision_thresholds);
  if (!archive.reading()) return;
  fci.place = archive.self().place();
  check_address(archive.at("address"), fci, reader);
}

}  // namespace multipanda

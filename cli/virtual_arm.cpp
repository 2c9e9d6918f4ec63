#include <atomic>
#include <cerrno>
#include <poll.h>
#include <string>
#include <sys/eventfd.h>
#include <unistd.h>

#include <fmt/format.h>
#include <nlohmann/json.hpp>

#include "cli/cockpit_link.hpp"
#include "cli/program.hpp"
#include "cli/run_arguments.hpp"
#include "common/process.hpp"
#include "common/text.hpp"
#include "fci/server/virtual_arms.hpp"
#include "scene/build.hpp"
#include "scene/hidden_plant.hpp"
#include "scene/load.hpp"

// `multipanda virtual-arm` offers a scene's arms to libfranka programs like real ones (docs/virtual_arm.md).
namespace multipanda::cli {
namespace {

using nlohmann::json;

// Below the control loop's priority of 80: a late torque is worse than a late state.
constexpr int kPriority = 75;

struct VirtualArmArguments {
  std::string scene, pace = "realtime";
  std::vector<std::string> bind, protocol, phase_us, drift_ppm;
  bool strict = false, scene_model = false;
  std::vector<int> ports;
  double latency_us = 0, jitter_us = 0;
  fci::DatagramFaults faults;
  std::uint64_t seed = 1;
  std::optional<std::uint64_t> hidden;
  std::optional<double> rotor_hidden, transmission_stiffness, gear_ripple;
  double seconds = 0;
  bool no_gripper = false, real_time_thread = false, idle_stands_still = false, json = false,
       until_input_ends = false;
  CockpitArguments cockpit;
};

// The arm and the text of an argument `--OPTION ARM=TEXT`.
std::pair<std::size_t, std::string> of_arm(const char* option, const char* what, const std::string& argument,
                                           const Scene& scene) {
  const std::vector<std::string> names = names_in(scene.arms);
  const auto pair = key_and_value(argument);
  if (!pair)
    throw UsageError(fmt::format("virtual-arm: expected {} ARM={}, found '{}'", option, what, argument));
  const auto& [name, text] = *pair;
  const auto found = std::find(names.begin(), names.end(), name);
  if (found == names.end())
    throw UsageError(
        fmt::format("virtual-arm: the scene has no arm '{}'{}", name, name_hint(name, names, "it has none")));
  return {static_cast<std::size_t>(found - names.begin()), text};
}

// --phase-us ARM=NUMBER, --drift-ppm ARM=NUMBER
std::vector<fci::ClockOffset> clocks_of(const VirtualArmArguments& arguments, const Scene& scene) {
  if (arguments.phase_us.empty() && arguments.drift_ppm.empty()) return {};
  std::vector<fci::ClockOffset> clocks(scene.arms.size());
  const auto number = [&](const char* option, const std::string& argument, double low, double high) {
    const auto [arm, text] = of_arm(option, "NUMBER", argument, scene);
    double value = 0;
    if (!read_number(text, value) || !(value >= low && value <= high))
      throw UsageError(fmt::format("virtual-arm: {}: expected a number from {} to {}, found '{}'", option,
                                   low, high, text));
    return std::pair{arm, value};
  };
  for (const auto& argument : arguments.phase_us) {
    const auto [arm, value] = number("--phase-us", argument, 0, 1000);
    clocks[arm].phase_s = 1e-6 * value;
  }
  for (const auto& argument : arguments.drift_ppm) {
    const auto [arm, value] = number("--drift-ppm", argument, -10000, 10000);
    clocks[arm].drift_ppm = value;
  }
  return clocks;
}

// --protocol ARM=VERSION
fci::VersionRange versions_of(const std::string& text) {
  if (text == "any") return {};
  for (const fci::Dialect& dialect : fci::kDialects) {
    if (text == std::to_string(dialect.version)) return {dialect.version, dialect.version};
  }
  throw UsageError(
      fmt::format("virtual-arm: --protocol: expected a version from 4 to 10, or any, found '{}'", text));
}

// --bind ARM=ADDRESS, --protocol ARM=VERSION
std::vector<fci::ArmPlace> places_of(const VirtualArmArguments& arguments, const Scene& scene) {
  std::vector<fci::ArmPlace> places(scene.arms.size());
  for (const auto& argument : arguments.bind) {
    const auto [arm, address] = of_arm("--bind", "ADDRESS", argument, scene);
    places[arm].address = address;
    fci::is_loopback(address);  // refuses an invalid address
  }
  for (const auto& argument : arguments.protocol) {
    const auto [arm, version] = of_arm("--protocol", "VERSION", argument, scene);
    places[arm].versions = versions_of(version);
  }
  if (!arguments.ports.empty()) {
    for (auto& place : places) {
      place.port = static_cast<std::uint16_t>(arguments.ports[0]);
      place.gripper_port = static_cast<std::uint16_t>(arguments.ports[1]);
      place.vacuum_port = static_cast<std::uint16_t>(arguments.ports[2]);
    }
  }
  return places;
}

json listening(const fci::VirtualArms& arms) {
  json result = json::object();
  for (ArmIndex i = 0; i < arms.arm_count(); ++i) {
    const auto& place = arms.place(i);
    json& said = result[arms.names()[i]] = {{"address", place.address}, {"port", place.port}};
    if (arms.has_gripper(i)) said["gripper_port"] = place.gripper_port;
    if (arms.has_vacuum(i)) said["vacuum_port"] = place.vacuum_port;
  }
  return {{"listening", result}};
}

json to_json(const fci::PortStatistics& s) {
  return {{"clients", s.clients},
          {"refused", s.refused},
          {"motions", s.motions},
          {"states_sent", s.states_sent},
          {"states_lost", s.states_lost},
          {"commands_received", s.commands_received},
          {"commands_used", s.commands_used},
          {"commands_late", s.commands_late},
          {"commands_lost", s.commands_lost},
          {"commands_missed", s.commands_missed},
          {"bad_datagrams", s.bad_datagrams},
          {"bad_requests", s.bad_requests}};
}

void print_addresses(const fci::VirtualArms& arms, const Console& console) {
  for (ArmIndex i = 0; i < arms.arm_count(); ++i) {
    const auto& place = arms.place(i);
    const std::string more = arms.has_gripper(i)  ? fmt::format(", gripper at {}", place.gripper_port)
                             : arms.has_vacuum(i) ? fmt::format(", vacuum gripper at {}", place.vacuum_port)
                                                  : "";
    console.line(fmt::format(
        "arm {}: {}:{}{}{}", arms.names()[i], place.address, place.port, more,
        fci::is_loopback(place.address) ? "" : " (reachable from other computers, which can move it)"));
  }
}

void print_statistics(const fci::VirtualArms& arms, const Console& console) {
  const auto world = arms.world_statistics();
  console.line(fmt::format("{:.3f} s of world time{}", 1e-3 * static_cast<double>(world.periods),
                           world.overruns == 0 ? "" : fmt::format(", {} ms dropped", world.overruns)));
  for (ArmIndex i = 0; i < arms.arm_count(); ++i) {
    const auto s = arms.statistics(i);
    console.line(fmt::format(
        "arm {}: {} programs, {} motions; states: {} sent, {} lost; commands: {} received, {} used, {} late, "
        "{} lost, {} missing",
        arms.names()[i], s.clients, s.motions, s.states_sent, s.states_lost, s.commands_received,
        s.commands_used, s.commands_late, s.commands_lost, s.commands_missed));
  }
}

// Returns after a signal, `seconds`, or the end of the world. Handles lines from standard input meanwhile.
void wait_for_end(fci::VirtualArms& arms, int end_file, const VirtualArmArguments& arguments,
                  const Console& console) {
  const double seconds = arguments.seconds;
  const HostTime end = host_now() + std::chrono::nanoseconds(static_cast<std::int64_t>(1e9 * seconds));
  std::string line;
  bool reads = true;
  while (arms.running()) {
    pollfd files[2] = {{.fd = end_file, .events = POLLIN, .revents = 0},
                       {.fd = reads ? STDIN_FILENO : -1, .events = POLLIN, .revents = 0}};
    if (::poll(files, 2, 100) < 0 && errno != EINTR) return;
    if (files[0].revents != 0 || (seconds > 0 && host_now() >= end)) return;
    if (files[1].revents == 0) continue;
    char bytes[512];
    const auto count = ::read(STDIN_FILENO, bytes, sizeof(bytes));
    if (count <= 0 && arguments.until_input_ends) return;
    if (count <= 0) reads = false;  // end of the input: the arms continue
    for (ssize_t i = 0; i < count; ++i) {
      if (bytes[i] != '\n') {
        if (line.size() < 512) line += bytes[i];
        continue;
      }
      const std::string answer = fci::control(arms, line);
      line.clear();
      if (!answer.empty()) console.line(answer);
    }
  }
}

int run(const VirtualArmArguments& arguments) {
  const Console console(arguments.json);
  OpenedScene opened = open_scene(arguments.scene);
  refuse_carried_arms(opened.scene, "a virtual arm");
  PlantFidelity& fidelity = opened.scene.plant;
  fci::let_rotors_act(opened.scene);
  for (SceneArm& arm : opened.scene.arms)
    arm.rotor_hidden = arguments.rotor_hidden.value_or(arm.rotor_hidden);
  fidelity.transmission_stiffness_nm_per_rad =
      arguments.transmission_stiffness.value_or(fidelity.transmission_stiffness_nm_per_rad);
  fidelity.gear_ripple_nm = arguments.gear_ripple.value_or(fidelity.gear_ripple_nm);
  if (arguments.rotor_hidden || arguments.transmission_stiffness || arguments.gear_ripple)
    fidelity.name += " (changed)";
  const Scene shown = opened.scene;  // nominal scene: hidden parameters stay hidden
  if (arguments.hidden) hide(opened.scene, *arguments.hidden);  // prints nothing about the drawn values
  fci::VirtualArmOptions options;
  options.places = places_of(arguments, opened.scene);
  options.pace = arguments.pace == "lockstep" ? fci::WorldPace::lockstep : fci::WorldPace::realtime;
  options.grippers = !arguments.no_gripper;
  options.faults = arguments.faults;
  options.faults.latency_s = 1e-6 * arguments.latency_us;
  options.faults.jitter_s = 1e-6 * arguments.jitter_us;
  options.seed = arguments.seed;
  options.strict = arguments.strict;
  if (arguments.scene_model) options.library = fci::LibraryModel::scene;
  options.clocks = clocks_of(arguments, opened.scene);
  if (!options.clocks.empty() && options.pace == fci::WorldPace::lockstep) {
    throw UsageError("virtual-arm: --phase-us and --drift-ppm need --pace realtime");
  }
  options.idle_stands_still = arguments.idle_stands_still;
  if (arguments.real_time_thread) {
    if (options.pace == fci::WorldPace::lockstep) {
      throw UsageError(
          "virtual-arm: --real-time needs --pace realtime; in lock-step the world waits for programs");
    }
    options.thread = ThreadSetup{.lock_memory = true, .fifo_priority = kPriority, .cpu = {}};
  }
  const int end_file = eventfd(0, EFD_CLOEXEC);
  const SignalWatch signals([end_file](int) {
    const std::uint64_t one = 1;
    [[maybe_unused]] const auto size = ::write(end_file, &one, sizeof(one));
  });
  const std::unique_ptr<CockpitLink> cockpit =
      arguments.cockpit.asked ? open_cockpit(arguments.cockpit.port) : nullptr;
  if (cockpit) options.on_period = cockpit->watch_world(shown);
  fci::VirtualArms arms(std::move(opened.scene), options);
  arms.start();
  for (const auto& step : arms.thread_setup()) {
    if (!step.done) console.line(fmt::format("no {}: {}", step.what, step.reason));
  }
  print_addresses(arms, console);
  console.line(fmt::format("{}; Ctrl-C ends; standard input takes commands, 'help' lists them",
                           options.pace == fci::WorldPace::lockstep
                               ? "the world waits for the programs' commands (lockstep)"
                               : "in real time"));
  if (cockpit) {
    cockpit->show_world(arms);
    print_address(*cockpit, console);
  }
  if (arguments.json) {
    fmt::print("{}\n", listening(arms).dump());
    std::fflush(stdout);
  }
  wait_for_end(arms, end_file, arguments, console);
  if (cockpit) cockpit->close("the virtual arms have ended");
  arms.stop();
  ::close(end_file);
  if (arguments.json) {
    json result = {{"periods", arms.world_statistics().periods},
                   {"given_up_ms", arms.world_statistics().overruns},
                   {"fault", arms.fault()}};
    for (ArmIndex i = 0; i < arms.arm_count(); ++i) {
      result["arms"][arms.names()[i]] = to_json(arms.statistics(i));
    }
    fmt::print("{}\n", json{{"ended", result}}.dump());
  } else {
    print_statistics(arms, console);
  }
  if (arms.failed()) {
    console.line("failed: " + arms.fault());
    return kFailed;
  }
  return kSuccess;
}

}  // namespace

void add_virtual_arm(Program& program) {
  auto arguments = std::make_shared<VirtualArmArguments>();
  CLI::App* command = program.add(
      "virtual-arm", "Offer the arms of a scene at the network ports that libfranka programs connect to",
      "  multipanda virtual-arm one_arm                      127.0.0.1, in real time, until Ctrl-C\n"
      "  multipanda virtual-arm two_arms --pace lockstep     127.0.0.1 and 127.0.0.2; time waits for "
      "programs\n"
      "  multipanda virtual-arm two_arms --bind left=127.0.0.5 --bind right=127.0.0.6\n"
      "  multipanda virtual-arm one_arm --latency-us 200 --loss 0.02 --seed 7");
  scene_option(command, arguments->scene);
  option(command, "--bind", arguments->bind,
         "Address of an arm (default 127.0.0.1 for the first, 127.0.0.2 for the second, ...)",
         named("ARM=ADDRESS"));
  option(command, "--protocol", arguments->protocol,
         "Version of the control interface that an arm accepts, 4 to 10, or any (default: that of its "
         "key fci; otherwise a Panda 4 and 5, a Franka Research 3 6 to 10)",
         named("ARM=VERSION"));
  option(command, "--pace", arguments->pace,
         "realtime, or lockstep: the world waits for the programs' commands",
         one_of({"realtime", "lockstep"}), shown);
  option(command, "--ports", arguments->ports,
         "Ports of arm, gripper and vacuum gripper; libfranka uses only 1337 1338 1339, "
         "0 chooses a free port",
         expecting(3), within(0, 65535), named("PORT"));
  option(command, "--latency-us", arguments->latency_us,
         "Delay of datagrams in each direction [us] (default 0)", within(0.0, 1e7));
  option(command, "--jitter-us", arguments->jitter_us,
         "Largest additional delay, uniformly distributed [us] (default 0)", within(0.0, 1e7));
  option(command, "--loss", arguments->faults.loss,
         "Fraction of datagrams that are lost, in each direction (default 0)", within(0.0, 1.0));
  option(command, "--duplicate", arguments->faults.duplicate,
         "Fraction of datagrams that arrive twice (default 0)", within(0.0, 1.0));
  option(command, "--reorder", arguments->faults.reorder,
         "Fraction of datagrams that are overtaken by the next one (default 0)", within(0.0, 1.0));
  command->add_flag("--strict", arguments->strict,
                    "Drop answers that are late, as a real arm does; without it some lateness is tolerated");
  command->add_flag("--scene-model", arguments->scene_model,
                    "Let a Panda send the scene's model as its library, not that of a real Panda");
  option(command, "--phase-us", arguments->phase_us,
         "Delay from the world's steps to an arm's states [us], 0 to 1000", named("ARM=NUMBER"));
  option(command, "--drift-ppm", arguments->drift_ppm,
         "Rate of an arm's clock relative to this computer's [ppm]; negative: slower", named("ARM=NUMBER"));
  option(command, "--seed", arguments->seed, "Random seed of the injected faults (default 1)");
  option(command, "--hidden", arguments->hidden,
         "Draw the true parameters of the arms around their models (masses, payload, friction, delay, tool) "
         "with this seed and keep them hidden, for trials of identify and refine",
         named("SEED"));
  option(command, "--rotor-hidden", arguments->rotor_hidden,
         "How much of the rotors' inertia the arms' torque loops hide, 0 to 1 (default: the scene's "
         "plant.rotor_inertia_hidden, otherwise 0)",
         within(0.0, 1.0), named("SHARE"));
  option(command, "--transmission-stiffness", arguments->transmission_stiffness,
         "Elastic joints, measured at their motors [N m/rad], in place of the scene's "
         "plant.transmission_stiffness_nm_per_rad",
         within(5e3, 1e6), named("NUMBER"));
  option(command, "--gear-ripple", arguments->gear_ripple,
         "Amplitude of the joints' torque ripple [N m], in place of the scene's plant.gear_ripple_nm",
         within(0.0, 2.0), named("NUMBER"));
  option(command, "--seconds", arguments->seconds, "End after this time [s] (default: at Ctrl-C)", positive);
  command->add_flag("--no-gripper", arguments->no_gripper, "Keep hands closed and offer no gripper ports");
  command->add_flag("--real-time", arguments->real_time_thread,
                    "Request real-time scheduling for the loop's thread (with --pace realtime)");
  command->add_flag("--idle-stands-still", arguments->idle_stands_still,
                    "In lock-step, stop the world while no arm moves");
  add_cockpit_arguments(
      command, arguments->cockpit,
      "Show the arms and their world in a browser on this computer, at a port of 127.0.0.1");
  command->add_flag("--until-input-ends", arguments->until_input_ends,
                    "End when standard input closes, as when the program that started them has ended");
  command->add_flag("--json", arguments->json, "Print one JSON line when all arms listen and one at the end");
  program.on(command, [arguments] { return run(*arguments); });
}

}  // namespace multipanda::cli

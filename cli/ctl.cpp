#include <algorithm>
#include <csignal>
#include <cstdio>
#include <cstdlib>
#include <map>
#include <optional>
#include <sys/socket.h>
#include <thread>
#include <unistd.h>

#include <fmt/format.h>
#include <fmt/ranges.h>
#include <nlohmann/json.hpp>

#include "cli/program.hpp"
#include "common/text.hpp"
#include "runtime/live_input/client.hpp"
#include "runtime/live_input/json_fields.hpp"
#include "runtime/live_input/socket_path.hpp"

// `multipanda ctl` commands a running scene through its socket (docs/live_input.md).
namespace multipanda::cli {
namespace {

using nlohmann::json;

struct CtlOptions {
  std::string socket;  // empty: that of the only running scene
  bool json = false;
  std::vector<std::string> names, stop, pairs;
  std::string name, input, value;
  bool only = false, all = false;
  double rate_hz = 2;
  std::uint64_t count = 0;
  std::map<std::string, std::optional<double>> numbers;  // optional ones, by their keys in requests
};

// The numbers of "0.4,0,pi/2".
std::vector<double> numbers_of(const std::string& text) {
  std::vector<double> numbers;
  for (std::size_t begin = 0; begin <= text.size();) {
    const std::size_t comma = std::min(text.find(',', begin), text.size());
    const std::string part = text.substr(begin, comma - begin);
    if (!read_number(part, numbers.emplace_back()))
      throw UsageError(fmt::format("ctl: expected a number, found '{}'", part));
    begin = comma + 1;
  }
  return numbers;
}

// Adds "position_m=0.4,0,0.5" to the request. Lists stay lists, even with one element.
void add_pairs(const std::vector<std::string>& pairs, json& request) {
  for (const auto& pair : pairs) {
    const std::size_t equals = pair.find('=');
    if (equals == std::string::npos || equals == 0) {
      throw UsageError(
          fmt::format("ctl: expected KEY=VALUE, such as position_m=0.4,0,0.5; found '{}'", pair));
    }
    const std::string key = pair.substr(0, equals), text = pair.substr(equals + 1);
    if (key == "frame") {
      request[key] = text;
      continue;
    }
    const std::vector<double> numbers = numbers_of(text);
    const bool one = key == "value" || key == "duration_s" || key == "mass_kg";
    request[key] = one && numbers.size() == 1 ? json(numbers[0]) : json(numbers);
  }
}

LiveClient connected(const CtlOptions& options) {
  return LiveClient(options.socket.empty() ? only_running_socket() : std::filesystem::path(options.socket));
}

std::string names(const json& list) {
  return list.empty() ? "none" : fmt::format("{}", fmt::join(list.get<std::vector<std::string>>(), ", "));
}

void print_details(const json& controllet) {
  for (const auto& input : controllet["inputs"]) {
    fmt::print("      input {}: {} in {} ({})\n", input["name"].get<std::string>(),
               input["quantity"].get<std::string>(), input["frame"].get<std::string>(), names(input["keys"]));
  }
  for (const auto& feature : controllet["features"]) {
    fmt::print("      feature {}: {}\n", feature["name"].get<std::string>(),
               feature["on"].get<bool>() ? "on" : "off");
  }
  for (const auto& parameter : controllet["parameters"]) {
    fmt::print("      {} = {} {}\n", parameter["name"].get<std::string>(), parameter["value"].dump(),
               parameter.value("unit", ""));
  }
}

void print_list(const json& list, bool details) {
  fmt::print("scene {}\n", list["scene"].get<std::string>());
  for (const auto& c : list["controllets"]) {
    fmt::print("{} {:<24} {:<32} {}\n", c["active"].get<bool>() ? "*" : " ", c["name"].get<std::string>(),
               c["type"].get<std::string>(), names(c["arms"]));
    if (details) print_details(c);
  }
  fmt::print("(* active{})\n",
             details ? "" : "; inputs, features and parameters: multipanda ctl list NAME, or --all");
}

void print_state(const json& state) {
  fmt::print("{:.3f} s  cycle {}  {:.0f} Hz  {:.1f} us  {} overruns\n", state["t_s"].get<double>(),
             state["cycle"].get<std::uint64_t>(), state["rate_hz"].get<double>(),
             state["cycle_us"].get<double>(), state["overruns"].get<std::uint64_t>());
  for (const auto& arm : state["arms"]) {
    const auto p = arm["position_m"].get<std::vector<double>>();
    const std::string removed = arm.value("removed_by", ""),
                      last = arm["last_intervention"].get<std::string>();
    fmt::print("  {:<12} {:<24} {}{}  [{:.4f}, {:.4f}, {:.4f}] m  q [{:.3f}] rad{}\n",
               arm["arm"].get<std::string>(), arm["controllet"].get<std::string>(),
               arm["mode"].get<std::string>(), arm["stopped"].get<bool>() ? ", stopped" : "", p[0], p[1],
               p[2], fmt::join(arm["q_rad"].get<std::vector<double>>(), ", "),
               !removed.empty() ? "  removed by: " + removed
               : last.empty()   ? ""
                                : "  last intervention: " + last);
    if (arm.contains("connection")) {
      const json& c = arm["connection"];
      fmt::print("    packets: {} received, {} lost, {} late; commands missed: {}\n",
                 c["received"].get<std::uint64_t>(), c["lost"].get<std::uint64_t>(),
                 c["late"].get<std::uint64_t>(), c["commands_missed"].get<std::uint64_t>());
    }
    if (arm.contains("reason")) fmt::print("    stopped itself: {}\n", arm["reason"].get<std::string>());
  }
}

void print_done(const json& answer) {
  if (answer.contains("started")) {
    fmt::print("started {}; stopped {}; kept {}\n", names(answer["started"]), names(answer["stopped"]),
               names(answer["kept"]));
  }
  if (answer.contains("times_ms")) {
    const json& t = answer["times_ms"];
    fmt::print("taken after {:.3f} ms in cycle {}, first torque {:.3f} ms later\n",
               t["received_to_taken"].get<double>(), answer["cycle"].get<std::uint64_t>(),
               t["taken_to_first_torque"].get<double>());
  }
  for (const auto& step : answer.value("torque_steps", json::array())) {
    fmt::print("  {}: largest torque step {:.3f} N m\n", step["arm"].get<std::string>(),
               step["sent_nm"].get<double>());
  }
  if (answer.contains("stopped_after_ms")) {
    fmt::print("stopped: {} (after {:.3f} ms); resume with: multipanda ctl resume\n",
               names(answer["stopped"]), answer["stopped_after_ms"].get<double>());
    if (answer.contains("message"))
      fmt::print(stderr, "multipanda ctl: {}\n", answer["message"].get<std::string>());
  } else if (answer.contains("message")) {
    fmt::print("{}\n", answer["message"].get<std::string>());
  } else if (answer.contains("log")) {
    fmt::print("{}\n", answer["log"].get<std::string>());
  } else if (!answer.contains("times_ms")) {
    fmt::print("done\n");
  }
}

// A request that was not understood was not executed: it counts as a usage error.
int exit_code(const json& answer) {
  if (answer.value("ok", false)) return kSuccess;
  const std::string verdict = answer.value("verdict", "");
  return verdict == "malformed" || verdict == "wrong_size" || verdict.starts_with("unknown_") ? kUsage
                                                                                              : kFailed;
}

constexpr double kGripperPatience = 620;  // [s]; the run itself gives up after 600 s

// Reduces a state to that of one gripper.
void reduce_to_gripper(const std::string& arm, json& answer) {
  for (const auto& state : answer["state"]["arms"]) {
    if (state["arm"] != arm) continue;
    if (!state.contains("gripper")) throw UsageError(fmt::format("ctl: arm '{}' has no gripper", arm));
    answer = {{"ok", true}, {"gripper", state["gripper"]}};
    return;
  }
  throw UsageError(fmt::format("ctl: there is no arm '{}'", arm));
}

void print_gripper(const json& gripper) {
  const double width = gripper["width_m"].get<double>(), most = gripper["max_width_m"].get<double>();
  const bool holds = gripper["grasped"].get<bool>();
  const char* moves = gripper["moving"].get<bool>() ? ", moves" : "";
  if (width == 0 && most == 0) {  // no fingers
    fmt::print("{}{}\n", holds ? "holds a part" : "holds nothing", moves);
    return;
  }
  const std::string range = most > 0 ? fmt::format(" of {:.1f} mm", 1000 * most) : ", not homed yet";
  fmt::print("{:.1f} mm{}{}{}\n", 1000 * width, range, holds ? ", holds something" : "", moves);
}

int ask(const CtlOptions& options, json request) {
  LiveClient client = connected(options);
  const auto is = [&](const char* key, const char* value) {
    return request.contains(key) && request[key] == value;
  };
  const bool is_gripper = is("do", "gripper") || is("do", "vacuum");
  const bool is_state = is_gripper && is("action", "state");
  const std::string arm = is_state ? request["arm"].get<std::string>() : "";
  if (is_state) request = {{"do", "state"}};
  if (is("do", "resume")) {  // later stops are not resumed
    const json seen = client.ask({{"do", "state"}});
    if (seen.value("ok", false)) request["stops"] = seen["state"]["stops"];
  }
  json answer =
      is_gripper ? client.ask(std::move(request), kGripperPatience) : client.ask(std::move(request));
  if (is_state && answer.value("ok", false)) reduce_to_gripper(arm, answer);
  answer.erase("id");
  const int code = exit_code(answer);
  if (options.json) {
    fmt::print("{}\n", to_line(answer));
  } else if (code != kSuccess) {
    fmt::print(stderr, "multipanda ctl: {}\n", answer.value("reason", "refused"));
  } else if (answer.contains("gripper")) {
    print_gripper(answer["gripper"]);
  } else if (answer.contains("controllets")) {
    print_list(answer, true);
  } else if (answer.contains("state")) {
    print_state(answer["state"]);
  } else {
    print_done(answer);
  }
  return code;
}

// The named run's arms, or those of all runs; of all runs, too, if no run listens at the named socket. No run
// waits for another one.
int stop(const CtlOptions& options) {
  const std::string here = options.socket.empty() ? "" : std::filesystem::absolute(options.socket).string();
  std::vector<std::filesystem::path> sockets;
  if (const int file = here.empty() ? -1 : connect_to(here, SOCK_STREAM); file >= 0) {
    close(file);
    sockets.emplace_back(here);
  } else {
    sockets = all_running_sockets();
  }
  if (sockets.empty()) throw std::runtime_error("no scene is running on this computer: nothing was stopped");
  std::vector<json> answers(sockets.size());
  {
    std::vector<std::jthread> threads;
    for (std::size_t i = 0; i < sockets.size(); ++i) {
      threads.emplace_back([&, i] {
        try {
          answers[i] = stop_run(sockets[i], options.names);
        } catch (const std::exception& error) {
          answers[i] = {{"ok", false}, {"reason", error.what()}};
        }
      });
    }
  }
  int code = kSuccess;
  for (std::size_t i = 0; i < sockets.size(); ++i) {
    answers[i].erase("id");
    if (sockets.size() > 1) answers[i]["socket"] = sockets[i].string();
    const bool ok = answers[i].value("ok", false);
    if (!ok) code = kFailed;
    if (options.json) {
      fmt::print("{}\n", to_line(answers[i]));
      continue;
    }
    if (sockets.size() > 1) fmt::print("{}: ", sockets[i].stem().string());
    std::fflush(stdout);
    if (ok) {
      print_done(answers[i]);
    } else {
      fmt::print(stderr, "multipanda ctl: {}\n", answers[i].value("reason", "refused"));
    }
  }
  if (here.empty() || sockets.front() == here) return code;
  fmt::print(stderr, "multipanda ctl: no run listens at '{}': all runs are stopped\n", here);
  return kFailed;
}

// All controllets in short, or the named ones with everything that can be set.
int list(const CtlOptions& options) {
  LiveClient client = connected(options);
  json answer = client.ask({{"do", "list"}});
  answer.erase("id");
  if (!options.names.empty()) {
    std::vector<std::string> known;
    json chosen = json::array();
    for (const auto& controllet : answer["controllets"]) {
      known.push_back(controllet["name"].get<std::string>());
      if (std::find(options.names.begin(), options.names.end(), known.back()) != options.names.end())
        chosen.push_back(controllet);
    }
    for (const auto& name : options.names) {
      if (std::find(known.begin(), known.end(), name) == known.end())
        throw UsageError(fmt::format("ctl list: there is no controllet '{}'{}", name,
                                     name_hint(name, known, "there are none")));
    }
    answer["controllets"] = std::move(chosen);
  }
  if (options.json) {
    fmt::print("{}\n", to_line(answer));
  } else {
    print_list(answer, options.all || !options.names.empty());
  }
  return kSuccess;
}

int watch(const CtlOptions& options) {
  LiveClient client = connected(options);
  const json answer = client.ask({{"do", "subscribe"}, {"rate_hz", options.rate_hz}});
  if (!answer.value("ok", false)) throw UsageError("ctl watch: " + answer.value("reason", "refused"));
  for (std::uint64_t seen = 0; options.count == 0 || seen < options.count;) {
    const json line = client.next(60);
    if (!line.contains("state")) continue;
    ++seen;
    if (options.json) {
      fmt::print("{}\n", to_line(line["state"]));
    } else {
      print_state(line["state"]);
    }
    std::fflush(stdout);
  }
  return kSuccess;
}

// A number, a list of numbers, or a choice's name.
json parameter_value(const std::vector<std::string>& arguments) {
  std::vector<double> numbers;
  try {
    for (const auto& argument : arguments) {
      const auto more = numbers_of(argument);
      numbers.insert(numbers.end(), more.begin(), more.end());
    }
  } catch (const UsageError&) {
    if (arguments.size() == 1) return arguments[0];
    throw;
  }
  return numbers.size() == 1 ? json(numbers[0]) : json(numbers);
}

class Ctl {
 public:
  Ctl(Program& program, CLI::App* command, std::shared_ptr<CtlOptions> options)
      : program_(program), command_(command), options_(std::move(options)) {}

  CLI::App* add(const std::string& name, const std::string& what, const std::string& examples = "") {
    CLI::App* child = command_->add_subcommand(name, what);
    child->fallthrough();  // --socket and --json may be at the end
    child->footer("Example:\n  multipanda ctl " + name + (examples.empty() ? "" : " " + examples));
    return child;
  }
  template <typename Make>
  void asks(CLI::App* child, Make make) {
    program_.on(child, [options = options_, make] { return ask(*options, make(*options)); });
  }
  void arms(const std::string& name, const std::string& what) {
    CLI::App* child = add(name, what, "left");
    option(child, "arms", options_->names, "Names of arms (default: all)");
    asks(child, [name](const CtlOptions& o) {
      json request = {{"do", name}};
      if (!o.names.empty()) request["arms"] = o.names;
      return request;
    });
  }
  void arm(const std::string& name, const std::string& what) {
    CLI::App* child = add(name, what, "left");
    option(child, "arm", options_->name, "Name of the arm", required);
    asks(child, [name](const CtlOptions& o) { return json{{"do", name}, {"arm", o.name}}; });
  }
  // With `key`: the name of an arm or object, and "KEY=VALUE" ...
  void pairs(const std::string& name, const std::string& what, const std::string& example,
             const std::string& keys, const std::string& key, const json& request) {
    CLI::App* child = add(name, what, example);
    option(child, key, options_->name, "Name of the " + key, required);
    option(child, "pairs", options_->pairs, "KEY=VALUE: " + keys, required);
    asks(child, [key, request](const CtlOptions& o) {
      json whole = request;
      whole[key] = o.name;
      add_pairs(o.pairs, whole);
      return whole;
    });
  }
  void end_effector(CLI::App* child, const char* kind) {
    asks(child, [kind](const CtlOptions& o) {
      json request = {{"do", kind}, {"arm", o.name}, {"action", o.value}};
      for (const auto& [key, value] : o.numbers) {
        if (value) request[key] = *value;
      }
      return request;
    });
  }
  void plain(const std::string& name, const std::string& what, const json& request) {
    asks(add(name, what), [request](const CtlOptions&) { return request; });
  }

 private:
  Program& program_;
  CLI::App* command_;
  std::shared_ptr<CtlOptions> options_;
};

}  // namespace

void add_ctl(Program& program) {
  auto o = std::make_shared<CtlOptions>();
  CLI::App* command = program.add(
      "ctl", "Command a running scene over its socket: switches, references, parameters, stop, state",
      "  multipanda ctl list\n"
      "  multipanda ctl switch joint\n"
      "  multipanda ctl reference cartesian pose position_m=0.45,0.1,0.4 rpy_rad=pi,0,0 duration_s=2\n"
      "  multipanda ctl parameter cartesian translational_stiffness_n_per_m 400\n"
      "  multipanda ctl stop && multipanda ctl resume\n"
      "  multipanda ctl watch --rate 5\n"
      "Lists are separated by commas. Exit codes: 0 done; 1 refused; 2 not understood (includes unknown "
      "names).");
  option(command, "--socket", o->socket, "Socket of the run (default: that of the only running scene)");
  command->add_flag("--json", o->json, "Print the answer as one JSON object per line");
  command->require_subcommand(1);
  Ctl ctl(program, command, o);
  const auto text = [](CLI::App* child, const char* name, std::string& value, const char* what) {
    option(child, name, value, what, required);
  };

  CLI::App* list_command =
      ctl.add("list", "List the controllets, or inputs, features and parameters of some", "cartesian");
  option(list_command, "controllets", o->names, "Controllets to show in detail (default: a summary of all)");
  list_command->add_flag("--all", o->all, "Show all controllets in detail");
  program.on(list_command, [o] { return list(*o); });
  ctl.plain("state", "Print the current state", {{"do", "state"}});
  ctl.plain("keep", "Write the last 30 s as a log and print its path", {{"do", "keep"}});
  CLI::App* watch_command = ctl.add("watch", "Print the state repeatedly until Ctrl-C", "--rate 5");
  option(watch_command, "--rate", o->rate_hz, "States per second (default 2)", within(0.1, 1000.0));
  option(watch_command, "--count", o->count, "Number of states to print (default: no limit)");
  program.on(watch_command, [o] { return watch(*o); });

  CLI::App* change =
      ctl.add("switch", "Activate controllets; the previous owners of their arms stop", "joint --stop force");
  option(change, "controllets", o->names, "Controllets to activate");
  option(change, "--stop", o->stop, "Controllets to deactivate; arms without an owner are held");
  change->add_flag("--only", o->only, "Deactivate all other controllets");
  ctl.asks(change, [](const CtlOptions& c) {
    return json{{"do", "switch"}, {"activate", c.names}, {"deactivate", c.stop}, {"only", c.only}};
  });

  CLI::App* feature =
      ctl.add("feature", "Switch a feature of a controllet on or off", "cartesian joint_limits off");
  text(feature, "controllet", o->name, "Name of the controllet");
  text(feature, "feature", o->input, "Name of the feature");
  o->value = "on";
  option(feature, "value", o->value, "on or off (default on)", one_of({"on", "off"}));
  ctl.asks(feature, [](const CtlOptions& c) {
    return json{{"do", "feature"}, {"controllet", c.name}, {"name", c.input}, {"on", c.value == "on"}};
  });

  CLI::App* reference = ctl.add("reference", "Set a goal for an input of an active controllet",
                                "cartesian pose position_m=0.45,0.1,0.4 rpy_rad=pi,0,0 duration_s=2");
  text(reference, "controllet", o->name, "Name of the controllet");
  text(reference, "input", o->input, "Name of the input");
  option(reference, "pairs", o->pairs,
         "KEY=VALUE: position_m with rpy_rad or quaternion_wxyz, q_rad, force_n, torque_nm, "
         "linear_m_per_s, angular_rad_per_s, value; frame=world or ARM_base; duration_s",
         required);
  ctl.asks(reference, [](const CtlOptions& c) {
    json request = {{"do", "reference"}, {"controllet", c.name}, {"input", c.input}};
    add_pairs(c.pairs, request);
    return request;
  });

  CLI::App* parameter = ctl.add("parameter", "Set a parameter; its value is reached within 0.2 s",
                                "joint stiffness_nm_per_rad 100,100,100,100,50,50,50");
  text(parameter, "controllet", o->name, "Name of the controllet");
  text(parameter, "parameter", o->input, "Name of the parameter");
  option(parameter, "values", o->names,
         "One number for all elements, a number for each, or the name of a choice", required);
  ctl.asks(parameter, [](const CtlOptions& c) {
    return json{
        {"do", "parameter"}, {"controllet", c.name}, {"name", c.input}, {"value", parameter_value(c.names)}};
  });

  CLI::App* stop_command = ctl.add(
      "stop", "Hold arms from the next cycle until they are resumed; without --socket in all runs", "left");
  option(stop_command, "arms", o->names, "Names of arms (default, and with a wrong name: all)");
  program.on(stop_command, [o] { return stop(*o); });
  ctl.arms("resume", "Allow switches of stopped arms again; they are held until then");

  ctl.pairs("load", "Declare the payload of an arm", "left mass_kg=0.5 com_m=0,0,0.1",
            "mass_kg, com_m (in the flange frame)", "arm", {{"do", "set_load"}});
  CLI::App* frame = ctl.add("frames", "Set the end effector of an arm in its flange frame",
                            "left position_m=0,0,0.1 rpy_rad=0,0,0");
  text(frame, "arm", o->name, "Name of the arm");
  option(frame, "pairs", o->pairs, "KEY=VALUE: position_m with rpy_rad or quaternion_wxyz", required);
  ctl.asks(frame, [](const CtlOptions& c) {
    json request = {{"do", "set_frames"}, {"arm", c.name}, {"end_effector", json::object()}};
    add_pairs(c.pairs, request["end_effector"]);
    return request;
  });

  ctl.arm("recover", "Clear the error of an arm; it is held until a controllet is activated");
  ctl.arm("reconnect",
          "Connect to a real arm again after its connection was lost; a reflex stays until `recover`");
  CLI::App* user_stop =
      ctl.add("user-stop", "Simulation: press or release the stop button of an arm", "left on");
  text(user_stop, "arm", o->name, "Name of the arm");
  option(user_stop, "value", o->value, "on (pressed) or off (released)", required, one_of({"on", "off"}));
  ctl.asks(user_stop, [](const CtlOptions& c) {
    return json{{"do", "user_stop"}, {"arm", c.name}, {"pressed", c.value == "on"}};
  });

  CLI::App* gripper = ctl.add("gripper", "Move the gripper of an arm and wait for the end of the motion",
                              "left grasp --width 0.05");
  text(gripper, "arm", o->name, "Name of the arm");
  option(gripper, "action", o->value, "homing, move, grasp, stop or state", required,
         one_of({"homing", "move", "grasp", "stop", "state"}));
  option(gripper, "--width", o->numbers["width_m"], "Distance of the fingers for move and grasp [m]");
  option(gripper, "--speed", o->numbers["speed_m_per_s"],
         "Rate of change of the width for move and grasp [m/s] (default 0.1)");
  option(gripper, "--force", o->numbers["force_n"], "Force of each finger for grasp [N] (default 40)");
  option(gripper, "--tolerance", o->numbers["tolerance_m"],
         "Deviation of the width that counts as a grasp, either way [m] (default 0.005)");
  ctl.end_effector(gripper, "gripper");

  CLI::App* vacuum = ctl.add("vacuum", "Command the vacuum gripper of an arm and wait until it is done",
                             "left on --vacuum 100");
  text(vacuum, "arm", o->name, "Name of the arm");
  option(vacuum, "action", o->value, "on, drop, stop or state", required,
         one_of({"on", "drop", "stop", "state"}));
  option(vacuum, "--vacuum", o->numbers["vacuum_mbar"],
         "Vacuum for on, below ambient pressure [mbar] (default 100)");
  option(vacuum, "--timeout", o->numbers["timeout_s"], "Time limit for on and drop [s] (default 1)");
  ctl.end_effector(vacuum, "vacuum");

  ctl.pairs("place", "Simulation: place a free object", "box position_m=0.5,0,0.1",
            "position_m; rpy_rad or quaternion_wxyz (default: the orientation in the scene)", "object",
            {{"do", "place_object"}});
  ctl.pairs("push", "Simulation: push a free object", "box force_n=5,0,0 duration_s=0.2",
            "force_n at its center of mass, world axes, at most 100 N; duration_s (default 0.2, at most 2)",
            "object", {{"do", "push_object"}});
  ctl.plain("pause", "Simulation: pause the world", {{"do", "pause"}, {"paused", true}});
  ctl.plain("go", "Simulation: continue after a pause", {{"do", "pause"}, {"paused", false}});
  ctl.plain("reset", "Simulation: put the world back to its start", {{"do", "reset"}});

  CLI::App* raw = ctl.add("send", "Send any request as JSON (docs/live_input.md)", "'{\"do\": \"state\"}'");
  text(raw, "request", o->value, "JSON object with the key 'do'");
  ctl.asks(raw, [](const CtlOptions& c) {
    json request = json::parse(c.value, nullptr, false);
    if (!request.is_object()) throw UsageError("ctl send: expected a JSON object");
    return request;
  });
}

}  // namespace multipanda::cli

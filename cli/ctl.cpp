#include <algorithm>
#include <csignal>
#include <cstdlib>
#include <numbers>
#include <optional>

#include <fmt/format.h>
#include <fmt/ranges.h>
#include <nlohmann/json.hpp>

#include "cli/program.hpp"
#include "runtime/live_input/client.hpp"
#include "runtime/live_input/json_fields.hpp"

// `multipanda ctl`: a running scene from the command line, over its socket (docs/live_input.md).
namespace multipanda::cli {
namespace {

using nlohmann::json;

struct CtlOptions {
  std::string socket;  // empty: the only running scene's
  bool json = false;
  std::vector<std::string> names, stop, pairs;
  std::string name, input, value;
  bool only = false;
  double rate_hz = 2;
  std::uint64_t count = 0;
  std::optional<double> width_m, speed_m_per_s, force_n, tolerance_m, vacuum_mbar, timeout_s;
};

// "0.5", "pi", "-pi/2", "3*pi/4"
double number_of(const std::string& word) {
  const auto plain = [&](const std::string& text) {
    char* end = nullptr;
    const double value = std::strtod(text.c_str(), &end);
    if (text.empty() || *end != '\0')
      throw UsageError(fmt::format("ctl: expected a number, found '{}'", word));
    return value;
  };
  const std::size_t at = word.find("pi");
  if (at == std::string::npos) return plain(word);
  std::string before = word.substr(0, at), after = word.substr(at + 2);
  double value = std::numbers::pi;
  if (before == "-") {
    value = -value;
  } else if (!before.empty()) {
    if (before.back() != '*') throw UsageError(fmt::format("ctl: expected a number, found '{}'", word));
    before.pop_back();
    value *= plain(before);
  }
  if (after.empty()) return value;
  if (after.front() != '/') throw UsageError(fmt::format("ctl: expected a number, found '{}'", word));
  return value / plain(after.substr(1));
}

// "position_m=0.4,0,0.5" into the request's key; what is a list there is one here, however short.
void add_pairs(const std::vector<std::string>& pairs, json& request) {
  for (const auto& pair : pairs) {
    const std::size_t equals = pair.find('=');
    if (equals == std::string::npos || equals == 0) {
      throw UsageError(fmt::format("ctl: expected key=value, as position_m=0.4,0,0.5; found '{}'", pair));
    }
    const std::string key = pair.substr(0, equals), text = pair.substr(equals + 1);
    if (key == "frame") {
      request[key] = text;
      continue;
    }
    std::vector<double> numbers;
    for (std::size_t begin = 0; begin <= text.size();) {
      const std::size_t comma = std::min(text.find(',', begin), text.size());
      numbers.push_back(number_of(text.substr(begin, comma - begin)));
      begin = comma + 1;
    }
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

void print_list(const json& list) {
  fmt::print("scene {}\n", list["scene"].get<std::string>());
  for (const auto& c : list["controllets"]) {
    fmt::print("{} {:<24} {:<32} {}\n", c["active"].get<bool>() ? "*" : " ", c["name"].get<std::string>(),
               c["type"].get<std::string>(), names(c["arms"]));
    for (const auto& input : c["inputs"]) {
      fmt::print("      input {}: {} in {} ({})\n", input["name"].get<std::string>(),
                 input["quantity"].get<std::string>(), input["frame"].get<std::string>(),
                 names(input["keys"]));
    }
    for (const auto& feature : c["features"]) {
      fmt::print("      feature {}: {}\n", feature["name"].get<std::string>(),
                 feature["on"].get<bool>() ? "on" : "off");
    }
    for (const auto& parameter : c["parameters"]) {
      fmt::print("      {} = {} {}\n", parameter["name"].get<std::string>(), parameter["value"].dump(),
                 parameter.value("unit", ""));
    }
  }
  fmt::print("(* runs)\n");
}

void print_state(const json& state) {
  fmt::print("{:.3f} s  cycle {}  {:.0f} Hz  {:.1f} us  {} overruns\n", state["t_s"].get<double>(),
             state["cycle"].get<std::uint64_t>(), state["rate_hz"].get<double>(),
             state["cycle_us"].get<double>(), state["overruns"].get<std::uint64_t>());
  for (const auto& arm : state["arms"]) {
    const auto p = arm["position_m"].get<std::vector<double>>();
    const std::string last = arm["last_intervention"].get<std::string>();
    fmt::print("  {:<12} {:<24} {}{}  [{:.4f}, {:.4f}, {:.4f}] m  q [{:.3f}] rad{}\n",
               arm["arm"].get<std::string>(), arm["controllet"].get<std::string>(),
               arm["mode"].get<std::string>(), arm["stopped"].get<bool>() ? ", stopped" : "", p[0], p[1],
               p[2], fmt::join(arm["q_rad"].get<std::vector<double>>(), ", "),
               last.empty() ? "" : "  last intervention: " + last);
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
  } else if (!answer.contains("times_ms")) {
    fmt::print("done\n");
  }
}

// How a refusal ends the program: what could not be understood was not tried.
int exit_code(const json& answer) {
  if (answer.value("ok", false)) return kSuccess;
  const std::string verdict = answer.value("verdict", "");
  return verdict == "malformed" || verdict.starts_with("unknown_") ? kUsage : kFailed;
}

constexpr double kGripperPatience = 620;  // a motion may take long [s]

// What a gripper says of itself, from the state.
void keep_gripper(const std::string& arm, json& answer) {
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
  const auto is = [&](const char* key, const char* word) {
    return request.contains(key) && request[key] == word;
  };
  const bool is_gripper = is("do", "gripper") || is("do", "vacuum");
  const bool is_state = is_gripper && is("action", "state");
  const std::string arm = is_state ? request["arm"].get<std::string>() : "";
  if (is_state) request = {{"do", "state"}};
  json answer =
      is_gripper ? client.ask(std::move(request), kGripperPatience) : client.ask(std::move(request));
  if (is_state && answer.value("ok", false)) keep_gripper(arm, answer);
  answer.erase("id");
  const int code = exit_code(answer);
  if (options.json) {
    fmt::print("{}\n", to_line(answer));
  } else if (code != kSuccess) {
    fmt::print(stderr, "multipanda ctl: {}\n", answer.value("reason", "refused"));
  } else if (answer.contains("gripper")) {
    print_gripper(answer["gripper"]);
  } else if (answer.contains("controllets")) {
    print_list(answer);
  } else if (answer.contains("state")) {
    print_state(answer["state"]);
  } else {
    print_done(answer);
  }
  return code;
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

// A number, a list, or a word: as the parameter wants it.
json parameter_value(const std::vector<std::string>& words) {
  std::vector<double> numbers;
  try {
    for (const auto& word : words) numbers.push_back(number_of(word));
  } catch (const UsageError&) {
    if (words.size() == 1) return words[0];
    throw;
  }
  return numbers.size() == 1 ? json(numbers[0]) : json(numbers);
}

class Ctl {
 public:
  Ctl(Program& program, CLI::App* command, std::shared_ptr<CtlOptions> options)
      : program_(program), command_(command), options_(std::move(options)) {}

  CLI::App* add(const std::string& word, const std::string& what) {
    CLI::App* child = command_->add_subcommand(word, what);
    child->fallthrough();  // --socket and --json may stand at the end
    return child;
  }
  template <typename Make>
  void asks(CLI::App* child, Make make) {
    program_.on(child, [options = options_, make] { return ask(*options, make(*options)); });
  }
  void arms(const std::string& word, const std::string& what) {
    CLI::App* child = add(word, what);
    child->add_option("arms", options_->names, "Names of arms; none: all");
    asks(child, [word](const CtlOptions& o) {
      json request = {{"do", word}};
      if (!o.names.empty()) request["arms"] = o.names;
      return request;
    });
  }
  void arm(const std::string& word, const std::string& what) {  // of one arm, without anything else
    CLI::App* child = add(word, what);
    child->add_option("arm", options_->name)->required();
    asks(child, [word](const CtlOptions& o) { return json{{"do", word}, {"arm", o.name}}; });
  }
  void plain(const std::string& word, const std::string& what, const json& request) {
    asks(add(word, what), [request](const CtlOptions&) { return request; });
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
      "ctl", "Commands a running scene over its socket: switches, references, parameters, stop, state",
      "  multipanda ctl list\n"
      "  multipanda ctl switch joint                      whoever owned its arms stops\n"
      "  multipanda ctl reference cartesian pose position_m=0.45,0.1,0.4 rpy_rad=pi,0,0 duration_s=2\n"
      "  multipanda ctl parameter cartesian translational_stiffness_n_per_m 400\n"
      "  multipanda ctl stop && multipanda ctl resume\n"
      "  multipanda ctl watch --rate 5\n"
      "Exit code: 0 done, 1 refused, 2 not understood (unknown names included).");
  command->add_option("--socket", o->socket, "Socket of the run; default: the only running scene's");
  command->add_flag("--json", o->json, "The answer as one JSON object per line");
  command->require_subcommand(1);
  Ctl ctl(program, command, o);

  ctl.plain("list", "Arms, controllets, inputs, features, parameters", {{"do", "list"}});
  ctl.plain("state", "The present state", {{"do", "state"}});
  CLI::App* watch_word = ctl.add("watch", "The state, again and again, until Ctrl-C");
  watch_word->add_option("--rate", o->rate_hz, "Per second")->check(CLI::Range(0.1, 1000.0));
  watch_word->add_option("--count", o->count, "End after so many");
  program.on(watch_word, [o] { return watch(*o); });

  CLI::App* change = ctl.add("switch", "Activates controllets; whoever owned their arms stops");
  change->add_option("controllets", o->names, "Run afterwards");
  change->add_option("--stop", o->stop, "Stop; arms without an owner are held");
  change->add_flag("--only", o->only, "Everything else stops");
  ctl.asks(change, [](const CtlOptions& c) {
    return json{{"do", "switch"}, {"activate", c.names}, {"deactivate", c.stop}, {"only", c.only}};
  });

  CLI::App* feature = ctl.add("feature", "Switches a feature of a controllet");
  feature->add_option("controllet", o->name)->required();
  feature->add_option("feature", o->input)->required();
  feature->add_option("value", o->value, "on or off")->required()->check(CLI::IsMember({"on", "off"}));
  ctl.asks(feature, [](const CtlOptions& c) {
    return json{{"do", "feature"}, {"controllet", c.name}, {"name", c.input}, {"on", c.value == "on"}};
  });

  CLI::App* reference = ctl.add("reference", "Sets a goal for an input of a running controllet");
  reference->add_option("controllet", o->name)->required();
  reference->add_option("input", o->input)->required();
  reference
      ->add_option("pairs", o->pairs,
                   "key=value: position_m with rpy_rad or quaternion_wxyz, q_rad, force_n, torque_nm, "
                   "linear_m_per_s, angular_rad_per_s, value; frame=world|ARM_base, duration_s")
      ->required();
  ctl.asks(reference, [](const CtlOptions& c) {
    json request = {{"do", "reference"}, {"controllet", c.name}, {"input", c.input}};
    add_pairs(c.pairs, request);
    return request;
  });

  CLI::App* parameter = ctl.add("parameter", "Sets a parameter; it is approached within 0.2 s");
  parameter->add_option("controllet", o->name)->required();
  parameter->add_option("parameter", o->input)->required();
  parameter->add_option("values", o->names, "One number for all, one each, or a word")->required();
  ctl.asks(parameter, [](const CtlOptions& c) {
    return json{
        {"do", "parameter"}, {"controllet", c.name}, {"name", c.input}, {"value", parameter_value(c.names)}};
  });

  ctl.arms("stop", "All arms (or the named ones) to hold at the next cycle, until resumed");
  ctl.arms("resume", "Stopped arms may be switched again; they are still held until then");

  CLI::App* load = ctl.add("load", "Declares an arm's payload: mass_kg=0.5 com_m=0,0,0.1");
  load->add_option("arm", o->name)->required();
  load->add_option("pairs", o->pairs, "mass_kg, com_m (in the flange)")->required();
  ctl.asks(load, [](const CtlOptions& c) {
    json request = {{"do", "set_load"}, {"arm", c.name}};
    add_pairs(c.pairs, request);
    return request;
  });

  CLI::App* frame =
      ctl.add("frames", "Sets an arm's end effector in the flange: position_m=0,0,0.1 rpy_rad=0,0,0");
  frame->add_option("arm", o->name)->required();
  frame->add_option("pairs", o->pairs)->required();
  ctl.asks(frame, [](const CtlOptions& c) {
    json request = {{"do", "set_frames"}, {"arm", c.name}, {"end_effector", json::object()}};
    add_pairs(c.pairs, request["end_effector"]);
    return request;
  });

  ctl.arm("recover", "Clears an arm's error; it is held afterwards, until somebody switches");
  ctl.arm("reconnect", "A real arm whose connection was lost: connects anew, then as recover");
  CLI::App* user_stop = ctl.add("user-stop", "Simulation: presses an arm's stop button, or releases it");
  user_stop->add_option("arm", o->name)->required();
  user_stop->add_option("value", o->value, "pressed or released")
      ->required()
      ->check(CLI::IsMember({"pressed", "released"}));
  ctl.asks(user_stop, [](const CtlOptions& c) {
    return json{{"do", "user_stop"}, {"arm", c.name}, {"pressed", c.value == "pressed"}};
  });

  const auto number = [](CLI::App* child, const char* flag, std::optional<double>& value, const char* what) {
    child->add_option(flag, value, what);
  };
  CLI::App* gripper = ctl.add("gripper", "Moves an arm's gripper; returns when the motion is over");
  gripper->add_option("arm", o->name)->required();
  gripper->add_option("action", o->value, "homing, move, grasp, stop, state")
      ->required()
      ->check(CLI::IsMember({"homing", "move", "grasp", "stop", "state"}));
  number(gripper, "--width", o->width_m, "move, grasp: between the fingers [m]");
  number(gripper, "--speed", o->speed_m_per_s, "move, grasp: of the width [m/s], default 0.1");
  number(gripper, "--force", o->force_n, "grasp: of each finger [N], default 40");
  number(gripper, "--tolerance", o->tolerance_m, "grasp: of the width, both ways [m], default 0.005");
  ctl.asks(gripper, [](const CtlOptions& c) {
    json request = {{"do", "gripper"}, {"arm", c.name}, {"action", c.value}};
    if (c.width_m) request["width_m"] = *c.width_m;
    if (c.speed_m_per_s) request["speed_m_per_s"] = *c.speed_m_per_s;
    if (c.force_n) request["force_n"] = *c.force_n;
    if (c.tolerance_m) request["tolerance_m"] = *c.tolerance_m;
    return request;
  });

  CLI::App* vacuum = ctl.add("vacuum", "Commands an arm's vacuum gripper; returns when it is done");
  vacuum->add_option("arm", o->name)->required();
  vacuum->add_option("action", o->value, "on, drop, stop, state")
      ->required()
      ->check(CLI::IsMember({"on", "drop", "stop", "state"}));
  number(vacuum, "--vacuum", o->vacuum_mbar, "on: below ambient pressure [mbar], default 100");
  number(vacuum, "--timeout", o->timeout_s, "on, drop: [s], default 1");
  ctl.asks(vacuum, [](const CtlOptions& c) {
    json request = {{"do", "vacuum"}, {"arm", c.name}, {"action", c.value}};
    if (c.vacuum_mbar) request["vacuum_mbar"] = *c.vacuum_mbar;
    if (c.timeout_s) request["timeout_s"] = *c.timeout_s;
    return request;
  });

  CLI::App* place = ctl.add("place", "Simulation: puts a free object somewhere");
  place->add_option("object", o->name)->required();
  place->add_option("pairs", o->pairs, "position_m, rpy_rad or quaternion_wxyz")->required();
  ctl.asks(place, [](const CtlOptions& c) {
    json request = {{"do", "place_object"}, {"object", c.name}};
    add_pairs(c.pairs, request);
    return request;
  });
  ctl.plain("pause", "Simulation: the world stands still", {{"do", "pause"}, {"paused", true}});
  ctl.plain("go", "Simulation: it moves on", {{"do", "pause"}, {"paused", false}});
  ctl.plain("reset", "Simulation: the world as at the start", {{"do", "reset"}});

  CLI::App* raw = ctl.add("send", "Any request as JSON");
  raw->add_option("request", o->value, "{\"do\": ...}")->required();
  ctl.asks(raw, [](const CtlOptions& c) {
    json request = json::parse(c.value, nullptr, false);
    if (!request.is_object()) throw UsageError("ctl send: expected a JSON object");
    return request;
  });
}

}  // namespace multipanda::cli

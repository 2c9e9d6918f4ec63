#include "runtime/embedded/hosted_trace.hpp"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <sched.h>
#include <stdexcept>
#include <unistd.h>

#include <nlohmann/json.hpp>

#include "common/machine.hpp"
#include "common/text.hpp"

namespace multipanda {
namespace {

namespace fs = std::filesystem;
using Json = nlohmann::ordered_json;

const std::string kHead = "performance_trace";
constexpr double kLongest_s = 300;  // of two arms: 400 MB

[[noreturn]] void refuse(const std::string& parameter, const std::string& why) {
  throw std::invalid_argument("parameter '" + parameter + "': " + why);
}

std::string text_of(const std::string& name, const ParameterValue& value) {
  const auto* text = std::get_if<std::string>(&value);
  if (text == nullptr || text->empty()) refuse(name, "expected a text that is not empty");
  return *text;
}

double seconds_of(const std::string& name, const ParameterValue& value, double least) {
  double s = NAN;
  if (const auto* number = std::get_if<double>(&value)) s = *number;
  if (const auto* whole = std::get_if<std::int64_t>(&value)) s = static_cast<double>(*whole);
  if (!(s >= least && s <= kLongest_s))
    refuse(name, "expected a number from " + (least > 0 ? std::string("0.001") : std::string("0")) + " to " +
                     std::to_string(static_cast<int>(kLongest_s)) + " s");
  return s;
}

// Part of the file name.
std::string condition_of(const std::string& name, const ParameterValue& value) {
  const std::string condition = text_of(name, value);
  const bool plain = std::ranges::all_of(condition, [](char c) {
    return (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || (c >= '0' && c <= '9') || c == '-' || c == '_';
  });
  if (!plain) refuse(name, "found '" + condition + "'; expected letters, digits, - and _, such as CA-MA");
  return condition;
}

std::size_t cycles(double s, double period_s) { return static_cast<std::size_t>(std::llround(s / period_s)); }

CommandTrace::Options trace_options(const HostedTraceOptions& options, const RecordLayout& layout,
                                    double period_s) {
  CommandTrace::Options trace{.lead = cycles(options.lead_s, period_s),
                              .samples = std::max<std::size_t>(cycles(options.duration_s, period_s), 1)};
  if (options.controllet.empty()) return trace;
  std::vector<std::string> names;
  for (const auto& instance : layout.instances) names.push_back(instance.name);
  const auto found = std::ranges::find(names, options.controllet);
  if (found == names.end())
    refuse(kHead + ".controllet", "there is no controllet '" + options.controllet + "'" +
                                      name_hint(options.controllet, names, "there are none"));
  trace.instance = static_cast<std::uint16_t>(found - names.begin());
  trace.streaming = true;
  return trace;
}

// Scheduling of a thread of this process by the operating system; null if the thread has ended.
Json scheduling(pid_t thread) {
  sched_param parameters{};
  const int policy = thread == 0 ? -1 : sched_getscheduler(thread);
  if (policy < 0 || sched_getparam(thread, &parameters) != 0) return nullptr;
  const int kind = policy & ~SCHED_RESET_ON_FORK;
  return kind == SCHED_FIFO ? "SCHED_FIFO " + std::to_string(parameters.sched_priority)
         : kind == SCHED_RR ? "SCHED_RR " + std::to_string(parameters.sched_priority)
                            : std::string("no real-time priority");
}

}  // namespace

std::optional<HostedTraceOptions> hosted_trace_options(const FlatParameters& parameters) {
  static const std::vector<std::string> keys{"folder", "condition", "controllet", "duration_s", "lead_s"};
  HostedTraceOptions options;
  bool any = false;
  for (const auto& [name, value] : parameters) {
    const auto dot = name.find('.');
    if (dot == std::string::npos) continue;
    if (name.substr(0, dot) != kHead) {
      if (nearest_name(name.substr(0, dot), {kHead}) == kHead)
        refuse(name, "did you mean '" + kHead + name.substr(dot) + "'?");
      continue;
    }
    any = true;
    const std::string key = name.substr(dot + 1);
    if (key == "folder") {
      options.folder = text_of(name, value);
    } else if (key == "condition") {
      options.condition = condition_of(name, value);
    } else if (key == "controllet") {
      options.controllet = text_of(name, value);
    } else if (key == "duration_s") {
      options.duration_s = seconds_of(name, value, 0.001);
    } else if (key == "lead_s") {
      options.lead_s = seconds_of(name, value, 0);
    } else {
      refuse(name, "unknown parameter" + name_hint(key, keys, ""));
    }
  }
  if (!any) return std::nullopt;
  if (options.folder.empty()) refuse(kHead + ".folder", "missing; name the folder for the file");
  if (!options.folder.is_absolute())
    refuse(kHead + ".folder",
           "found '" + options.folder.string() +
               "'; expected an absolute path, since the host's working directory is unknown");
  if (options.condition.empty())
    refuse(kHead + ".condition",
           "missing; name a condition of the experiment controller-performance, such as NF");
  return options;
}

HostedTrace::HostedTrace(HostedTraceOptions options, std::vector<HostedArm> arms, const RecordLayout& layout,
                         std::string scene_text, double period_s, Report report)
    : options_(std::move(options)),
      arms_(std::move(arms)),
      scene_text_(std::move(scene_text)),
      period_s_(period_s),
      report_(std::move(report)),
      trace_(layout, trace_options(options_, layout, period_s)) {
  std::error_code cause;
  fs::create_directories(options_.folder, cause);
  if (cause || ::access(options_.folder.c_str(), W_OK) != 0)
    throw std::runtime_error("parameter '" + kHead + ".folder': cannot write to " + options_.folder.string() +
                             "; name a folder that this program may write to");
  say("the next activation is measured; its file in " + options_.folder.string() +
      " is written when the controller is deactivated");
}

HostedTrace::~HostedTrace() {
  if (writer_.joinable()) writer_.join();
}

void HostedTrace::say(const std::string& text) const {
  if (report_) report_(kHead + ": " + text);
}

fs::path HostedTrace::free_name() const {
  for (int i = 1;; ++i) {
    fs::path file = options_.folder / (options_.condition + "_" + std::to_string(i) + ".npz");
    if (!fs::exists(file)) return file;
  }
}

std::string HostedTrace::about(std::uint64_t dropped) const {
  Json about{{"format", 1},
             {"condition", options_.condition},
             {"controllet", options_.controllet},
             {"arms", Json::array()},
             {"reports_command", Json::array()},
             {"period_s", period_s_},
             {"expected_samples", cycles(options_.duration_s, period_s_)},
             {"full", trace_.full()},
             {"records_dropped", dropped},
             {"scheduling", scheduling(trace_.loop_thread())},
             {"machine", describe_machine()},
             {"scene_text", scene_text_}};
  for (const auto& arm : arms_) {
    about["arms"].push_back(arm.name);
    // Without multipanda_state, tau_J_d is the torque sent and does not show the delay.
    if (arm.has_robot_state) about["reports_command"].push_back(arm.name);
  }
  return about.dump();
}

void HostedTrace::write(std::uint64_t dropped) noexcept {
  if (written_) return;
  written_ = true;
  try {
    writer_ = std::thread([this, dropped] { write_file(dropped); });
  } catch (...) {  // no thread could be started
    write_file(dropped);
  }
}

void HostedTrace::write_file(std::uint64_t dropped) noexcept {
  fs::path part;
  char why[200] = "unknown reason";
  try {
    if (!trace_.started()) {
      say(options_.controllet.empty() || trace_.streaming()
              ? "nothing was measured: the activation ended within lead_s"
              : "nothing was measured: '" + options_.controllet + "' followed no stream of set-points");
      return;
    }
    // Two controllers may share folder and condition: each writes a separate file until it is complete.
    static std::atomic<int> files{0};
    part = options_.folder /
           (options_.condition + ".part" + std::to_string(::getpid()) + "_" + std::to_string(++files));
    trace_.write(part, about(dropped));
    const fs::path file = free_name();
    fs::rename(part, file);
    say(std::to_string(trace_.count()) + " cycles are in " + file.string() +
        (trace_.full() ? "; its memory was full, so later cycles are missing" : "") +
        (dropped > 0 ? "; " + std::to_string(dropped) + " cycles were dropped" : ""));
    return;
  } catch (const std::exception& error) {
    std::snprintf(why, sizeof why, "%s", error.what());
  } catch (...) {
  }
  try {
    std::error_code ignored;
    if (!part.empty()) fs::remove(part, ignored);  // frees space on a full disk
    say(std::string("the measurement is lost: ") + why);
  } catch (...) {  // an exception of the report is ignored
  }
}

}  // namespace multipanda

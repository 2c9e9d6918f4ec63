#include "doctor/control_cycle.hpp"

#include <cerrno>
#include <cstring>
#include <fcntl.h>
#include <filesystem>
#include <spawn.h>
#include <sys/wait.h>
#include <unistd.h>

#include <fmt/format.h>
#include <nlohmann/json.hpp>

#include "doctor/timer.hpp"

extern char** environ;

namespace multipanda::doctor {
namespace {

constexpr double kPeriod_us = 1000;

// Runs a program to its end; its standard output. `status` as waitpid has it.
std::string output_of(const std::vector<std::string>& words, int& status) {
  int ends[2] = {-1, -1};
  if (pipe2(ends, O_CLOEXEC) != 0) throw std::runtime_error(std::strerror(errno));
  posix_spawn_file_actions_t actions;
  posix_spawn_file_actions_init(&actions);
  posix_spawn_file_actions_adddup2(&actions, ends[1], STDOUT_FILENO);
  std::vector<std::string> copies = words;
  std::vector<char*> arguments;
  for (auto& word : copies) arguments.push_back(word.data());
  arguments.push_back(nullptr);
  pid_t child = 0;
  const int error = posix_spawn(&child, arguments[0], &actions, nullptr, arguments.data(), environ);
  posix_spawn_file_actions_destroy(&actions);
  close(ends[1]);
  std::string text;
  if (error == 0) {
    char part[4096];
    for (;;) {
      const ssize_t size = read(ends[0], part, sizeof(part));
      if (size < 0 && errno == EINTR) continue;
      if (size <= 0) break;
      text.append(part, static_cast<std::size_t>(size));
    }
    while (waitpid(child, &status, 0) < 0 && errno == EINTR) {
    }
  }
  close(ends[0]);
  if (error != 0) throw std::runtime_error(fmt::format("{}: {}", words[0], std::strerror(error)));
  return text;
}

}  // namespace

ControlCycleReading parse_control_cycle(const std::string& json) {
  try {
    const auto object = nlohmann::json::parse(json);
    ControlCycleReading reading;
    reading.scene = object.at("scene").get<std::string>();
    reading.reason = object.value("reason", "");
    if (!reading.reason.empty()) return reading;
    reading.cycles = object.at("cycles").get<std::uint64_t>();
    reading.p50 = object.at("p50_us").get<double>();
    reading.p99 = object.at("p99_us").get<double>();
    reading.p999 = object.at("p999_us").get<double>();
    reading.worst = object.at("worst_us").get<double>();
    reading.guarded = object.at("guarded").get<bool>();
    reading.memory_locked = object.at("memory_locked").get<bool>();
    reading.heap_calls = object.at("heap_calls").get<std::uint64_t>();
    reading.lock_calls = object.at("lock_calls").get<std::uint64_t>();
    reading.page_faults = object.at("page_faults").get<std::uint64_t>();
    reading.interruptions = object.at("interruptions").get<std::uint64_t>();
    return reading;
  } catch (const nlohmann::json::exception& error) {
    throw std::runtime_error(
        fmt::format("the measuring program did not answer as expected: {}", error.what()));
  }
}

ControlCycleReading read_control_cycle(const std::string& scene, std::uint64_t cycles) {
  ControlCycleReading reading;
  reading.scene = scene;
  try {
    const auto self = std::filesystem::read_symlink("/proc/self/exe");
    int status = 0;
    const std::string text = output_of(
        {(self.parent_path() / "multipanda_cycle_probe").string(), scene, std::to_string(cycles)}, status);
    if (WIFSIGNALED(status)) {
      reading.reason = fmt::format("the measuring program was ended by signal {}", WTERMSIG(status));
      return reading;
    }
    return parse_control_cycle(text);
  } catch (const std::exception& error) {
    reading.reason = error.what();
  }
  return reading;
}

Finding judge_control_cycle(const ControlCycleReading& reading, Purpose purpose) {
  Finding finding{.id = "control_cycle", .subject = "control cycle"};
  if (!reading.reason.empty()) {
    finding.measured = fmt::format("scene {} was not measured", reading.scene);
    finding.cause = reading.reason;
    finding.cure = "multipanda check SCENE says what is wrong with a scene; --scene names another";
    return finding;
  }
  finding.measured = fmt::format(
      "scene {}: p50 {:.1f}, p99 {:.1f}, p99.9 {:.1f}, worst {:.1f} us of {:g} ({} cycles)", reading.scene,
      reading.p50, reading.p99, reading.p999, reading.worst, kPeriod_us, reading.cycles);
  finding.figures = {{"cycles", static_cast<double>(reading.cycles), ""},
                     {"p50", reading.p50, "us"},
                     {"p99", reading.p99, "us"},
                     {"p999", reading.p999, "us"},
                     {"worst", reading.worst, "us"},
                     {"budget", kPeriod_us, "us"},
                     {"interruptions", static_cast<double>(reading.interruptions), ""}};
  if (reading.p999 <= kAnswerLimit_us) {
    finding.judged = Judgement::ok;
    return finding;
  }
  // The median is the controllers' own cost; the tail of a thread that was interrupted is the computer's.
  const bool own = reading.p50 > kAnswerLimit_us / 2;
  finding.judged = reading.p999 > kPeriod_us && own ? defect(purpose) : Judgement::warning;
  finding.cause =
      own ? fmt::format(
                "the controllets and features of this scene need {:.0f} us themselves; an arm waits "
                "about {:g} us for its torque",
                reading.p50, kAnswerLimit_us)
          : fmt::format("half of the cycles are quick, a few are not: the thread was interrupted {} times",
                        reading.interruptions);
  finding.cure = own ? "switch features off one by one to find the costly one (collision_avoidance is the "
                       "first to try); "
                       "'multipanda bench' has the cost of each"
                     : "see load, SCHED_FIFO and kernel above";
  return finding;
}

Finding judge_loop_guard(const ControlCycleReading& reading, Purpose purpose) {
  Finding finding{.id = "loop_guard", .subject = "loop guard"};
  if (!reading.reason.empty()) {
    finding.measured = "not counted";
    finding.cause = reading.reason;
    return finding;
  }
  finding.measured =
      reading.guarded
          ? fmt::format("{} heap calls, {} locks, {} page faults in {} cycles", reading.heap_calls,
                        reading.lock_calls, reading.page_faults, reading.cycles)
          : fmt::format("{} page faults in {} cycles", reading.page_faults, reading.cycles);
  if (reading.guarded) {
    finding.figures = {{"heap_calls", static_cast<double>(reading.heap_calls), ""},
                       {"lock_calls", static_cast<double>(reading.lock_calls), ""}};
  }
  finding.figures.push_back({"page_faults", static_cast<double>(reading.page_faults), ""});
  if (reading.heap_calls > 0 || reading.lock_calls > 0) {
    finding.judged = defect(purpose);
    finding.cause =
        "a controllet or feature of the scene allocates or locks in its update(): that may wait for any "
        "other thread";
    finding.cure =
        "move what allocates into the constructor or start(); docs/writing_a_controllet.md shows how to test "
        "it";
    return finding;
  }
  if (reading.page_faults > 0) {
    finding.judged = reading.memory_locked ? Judgement::warning : Judgement::unknown;
    finding.cause = reading.memory_locked ? "memory is touched for the first time in the loop"
                                          : "memory could not be locked, so that pages may come and go";
    finding.cure = reading.memory_locked ? "let the controllet touch its memory in start()"
                                         : "cure the line 'right to lock memory' first";
    return finding;
  }
  if (!reading.guarded) {
    finding.cause =
        "heap calls and locks are not counted in this build (sanitizers replace malloc themselves)";
    return finding;
  }
  finding.judged = Judgement::ok;
  return finding;
}

}  // namespace multipanda::doctor

#include <algorithm>
#include <atomic>
#include <chrono>
#include <cstdint>
#include <filesystem>
#include <fstream>
#include <mutex>
#include <stdexcept>
#include <string>
#include <thread>
#include <unistd.h>
#include <utility>
#include <vector>

#include <fmt/format.h>

#include "common/process.hpp"
#include "runtime/session.hpp"
#include "scene/build.hpp"
#include "scene/load.hpp"
#include "sysid/refine/refine.hpp"

namespace multipanda {
namespace {

// `multipanda virtual-arm SCENE --hidden SEED` alongside this process: arms with hidden properties drawn from
// a seed. They run in lock-step; the world is paused while no arm moves.
class ArmProcess {
 public:
  struct Options {
    std::filesystem::path program;  // multipanda itself
    std::filesystem::path scene;
    std::uint64_t hidden = 1;                                    // seed of the plants
    bool motors = false;                                         // RefineTarget::motors
    std::vector<std::pair<std::string, std::string>> addresses;  // arm, loopback address
    std::filesystem::path messages;                              // file for its messages
  };
  // Returns when all arms listen. Throws std::runtime_error with the messages of the process.
  explicit ArmProcess(const Options& options);
  ~ArmProcess();

 private:
  static std::vector<std::string> arguments(const Options& options);

  ChildProcess process_;
};

using std::chrono::steady_clock;

constexpr std::chrono::seconds kPatience{20};  // to read the scene, build the world and listen

// One loopback address per arm, 127.x.y.z with x above 0. Addresses differ between calls of this process and
// most likely from those of other processes.
std::vector<std::string> free_addresses(std::size_t count) {
  static std::atomic<unsigned> next{0};
  const auto process = static_cast<unsigned>(getpid());
  std::vector<std::string> addresses;
  for (std::size_t i = 0; i < count; ++i) {
    const unsigned number = next.fetch_add(1);
    addresses.push_back("127." + std::to_string(1 + (process + number / 250) % 250) + "." +
                        std::to_string((process / 250) % 250) + "." + std::to_string(1 + number % 250));
  }
  return addresses;
}

ArmProcess::ArmProcess(const Options& options)
    : process_({.program = options.program,
                .arguments = arguments(options),
                .output = std::filesystem::path(options.messages).concat(".json"),
                .errors = options.messages}) {
  const auto until = steady_clock::now() + kPatience;
  while (process_.output().find("\"listening\"") == std::string::npos) {
    const bool ended = !process_.running();
    if (ended || steady_clock::now() > until) {
      throw std::runtime_error("the virtual arms of " + options.scene.string() +
                               (ended ? " ended before they were ready: " : " do not listen: ") +
                               process_.errors());
    }
    std::this_thread::sleep_for(std::chrono::milliseconds(5));
  }
}

ArmProcess::~ArmProcess() { process_.stop(std::chrono::seconds(3)); }

std::vector<std::string> ArmProcess::arguments(const Options& options) {
  std::vector<std::string> all{"virtual-arm",
                               options.scene.string(),
                               "--hidden",
                               std::to_string(options.hidden),
                               "--pace",
                               "lockstep",
                               "--idle-stands-still",
                               "--no-gripper",
                               "--json"};
  if (options.motors) {
    all.insert(all.end(),
               {"--rotor-hidden", "0.5", "--transmission-stiffness", "10000", "--gear-ripple", "0.2"});
  } else {
    all.insert(all.end(), {"--rotor-hidden", "1"});
  }
  for (const auto& [arm, address] : options.addresses) all.insert(all.end(), {"--bind", arm + "=" + address});
  return all;
}

namespace fs = std::filesystem;

void write_text(const fs::path& file, const std::string& text) {
  std::ofstream out(file);
  out << text;
  out.close();
  if (!out) throw std::runtime_error("cannot write " + file.string());
}

class Runner {
 public:
  Runner(const std::vector<ArmRun>& runs, const RunSettings& settings,
         const std::function<void(const ArmRunResult&)>& finished)
      : runs_(runs), settings_(settings), finished_(finished), done_(runs.size()) {}

  std::vector<ArmRunResult> run() {
    const bool real = !settings_.target.addresses.empty();
    const std::size_t workers = real ? 1 : std::clamp<std::size_t>(settings_.workers, 1, runs_.size());
    {
      std::vector<std::jthread> threads;
      for (std::size_t i = 1; i < workers; ++i) threads.emplace_back([this] { work(); });
      work();
    }
    if (failure_) std::rethrow_exception(failure_);
    std::vector<ArmRunResult> results;
    for (auto& result : done_) {
      if (result) results.push_back(std::move(*result));
    }
    return results;
  }

 private:
  bool stopped() const { return settings_.stop != nullptr && settings_.stop->load(); }

  void work() {
    for (;;) {
      const std::size_t index = next_.fetch_add(1);
      if (index >= runs_.size() || stopped()) return;
      try {
        ArmRunResult result = run_one(runs_[index]);
        const std::lock_guard lock(mutex_);
        if (finished_) finished_(result);
        done_[index] = std::move(result);
      } catch (...) {
        const std::lock_guard lock(mutex_);
        if (!failure_) failure_ = std::current_exception();
        next_ = runs_.size();
      }
    }
  }

  ArmRunResult run_one(const ArmRun& run) {
    const fs::path scratch = settings_.logs / (run.name + ".part");
    fs::create_directories(scratch);
    const Registry registry = build_registry(scene_plugins(run.scene, settings_.scene_path));
    Scene scene = parse_scene(run.scene, settings_.scene_path, registry);
    SessionOptions options{.paced = false, .record = scratch};
    // Simulated arms also run behind virtual ones, so that the arm itself estimates forces on both sides.
    // Their sensors are plain, as those of hidden plants.
    options.backend = {.kind = BackendKind::virtual_arms, .real_sensors = false};
    std::optional<ArmProcess> process;
    const RefineTarget& target = settings_.target;
    // Arms with ideal drives hide their rotors, and so does what is compared with them.
    if (target.addresses.empty() && !target.motors) scene.plant.rotor_hidden = 1;
    if (run.on_target && target.hidden) {
      ArmProcess::Options process_options{.program = settings_.program,
                                          .scene = scratch / "scene.yaml",
                                          .hidden = *target.hidden,
                                          .motors = target.motors,
                                          .messages = scratch / "arms.txt"};
      write_text(process_options.scene, run.scene);
      const auto places = free_addresses(scene.arms.size());
      for (std::size_t i = 0; i < scene.arms.size(); ++i) {
        process_options.addresses.emplace_back(scene.arms[i].name, places[i]);
      }
      process.emplace(process_options);
      options.backend = {.kind = BackendKind::fci, .addresses = process_options.addresses};
    } else if (run.on_target && !target.addresses.empty()) {
      options.backend = {.kind = BackendKind::fci, .addresses = target.addresses};
      options.paced = true;
    } else if (run.on_target) {
      for (auto& arm : scene.arms) {
        if (const auto known = target.known.find(arm.name); known != target.known.end()) {
          arm.plant_model = known->second;
        }
      }
    }
    Session session(std::move(scene), registry, std::move(options));
    session.start();
    while (!session.wait_for_end(0.1)) {
      if (stopped()) session.stop();
    }
    const RunSummary summary = session.finish();
    ArmRunResult result{.name = run.name,
                        .log = settings_.logs / (run.name + ".mcap"),
                        .faults = summary.faults(),
                        .time_s = summary.time_s,
                        .elapsed_s = summary.elapsed_s};
    fs::rename(summary.log, result.log);
    process.reset();
    fs::remove_all(scratch);
    return result;
  }

  const std::vector<ArmRun>& runs_;
  const RunSettings& settings_;
  const std::function<void(const ArmRunResult&)>& finished_;
  std::vector<std::optional<ArmRunResult>> done_;
  std::atomic<std::size_t> next_{0};
  std::mutex mutex_;
  std::exception_ptr failure_;
};

}  // namespace

std::string RefineTarget::words() const {
  if (hidden) {
    return fmt::format("virtual arms of another process, hidden plants of seed {}{}", *hidden,
                       motors ? " with rotors, elastic joints and gear ripple" : "");
  }
  if (!known.empty()) return "virtual arms of this process, known plants";
  std::string text = "real arms";
  for (const auto& [arm, address] : addresses) text += fmt::format(", {} at {}", arm, address);
  return text;
}

std::vector<ArmRunResult> run_all(const std::vector<ArmRun>& runs, const RunSettings& settings,
                                  const std::function<void(const ArmRunResult&)>& finished) {
  if (runs.empty()) return {};
  return Runner(runs, settings, finished).run();
}

}  // namespace multipanda

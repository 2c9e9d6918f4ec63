#include "experiments/processes.hpp"

#include <chrono>
#include <cstdint>
#include <filesystem>
#include <fstream>
#include <sstream>
#include <stdexcept>
#include <string>
#include <unistd.h>

namespace multipanda {
namespace {

namespace fs = std::filesystem;

// Run time and waiting time of one task [s]. Schedule statistics count nanoseconds; `stat` counts ticks of 10
// ms, a thirtieth of a sampling interval of 0.3 s.
ThreadUsage schedule_statistics(const fs::path& task) {
  std::ifstream file(task / "schedstat");
  double run_ns = 0, wait_ns = 0;
  if (!(file >> run_ns >> wait_ns)) return {};
  return {run_ns * 1e-9, wait_ns * 1e-9};
}

// utime + stime of `stat`, for kernels without schedule statistics.
double ticks_s(const fs::path& process) {
  std::ifstream file(process / "stat");
  std::string text;
  std::getline(file, text);
  const std::size_t name_end = text.rfind(')');  // the name may contain spaces
  if (name_end == std::string::npos) return 0;
  std::istringstream fields(text.substr(name_end + 1));
  std::string skipped;
  for (int i = 0; i < 11; ++i) fields >> skipped;
  double user = 0, system = 0;
  fields >> user >> system;
  return (user + system) / static_cast<double>(sysconf(_SC_CLK_TCK));
}

}  // namespace

GeneratorProcess::GeneratorProcess(const Options& options)
    : process_({.program = options.program,
                .arguments = arguments(options),
                .output = std::filesystem::path(options.messages).concat(".json"),
                .errors = options.messages}) {}

std::vector<std::string> GeneratorProcess::arguments(const Options& options) {
  std::vector<std::string> all{
      "generate", "circular-field", options.course.string(), "--seconds", std::to_string(options.seconds),
      "--json"};
  if (options.ros_node.empty()) {
    all.insert(all.end(), {"--socket", options.socket.string()});
  } else {
    all.insert(all.end(), {"--ros", "--node", options.ros_node});
  }
  return all;
}

nlohmann::ordered_json GeneratorProcess::finish(double timeout_s) {
  process_.stop(std::chrono::milliseconds(static_cast<std::int64_t>(timeout_s * 1e3)));
  auto report = nlohmann::ordered_json::parse(process_.output(), nullptr, false);
  if (report.is_discarded()) {
    throw std::runtime_error("the motion generator wrote no report (exit code " +
                             std::to_string(process_.exit_code()) + "); its messages:\n" + process_.errors());
  }
  return report;
}

std::filesystem::path own_program() {
  return std::filesystem::read_symlink("/proc/self/exe").parent_path() / "multipanda";
}

ProcessUsage process_usage(pid_t process) {
  const fs::path folder = fs::path("/proc") / std::to_string(process);
  std::ifstream memory(folder / "statm");
  double size = 0, resident = 0;
  if (!(memory >> size >> resident)) return {};
  ProcessUsage usage{.present = true};
  usage.memory_mb = resident * static_cast<double>(sysconf(_SC_PAGESIZE)) / (1 << 20);
  std::error_code gone;  // threads may end while they are counted
  for (const auto& task : fs::directory_iterator(folder / "task", gone))
    usage.cpu_s += schedule_statistics(task.path()).cpu_s;
  if (usage.cpu_s == 0) usage.cpu_s = ticks_s(folder);
  return usage;
}

ThreadUsage thread_usage(pid_t thread) {
  return schedule_statistics(fs::path("/proc/self/task") / std::to_string(thread));
}

MachineUsage machine_usage() {
  MachineUsage usage;
  std::ifstream statistics("/proc/stat");
  std::string word;
  double user = 0, nice = 0, system = 0, idle = 0, wait = 0, irq = 0, soft = 0, steal = 0;
  if (statistics >> word >> user >> nice >> system >> idle >> wait >> irq >> soft >> steal)
    usage.busy_s = (user + nice + system + irq + soft + steal) / static_cast<double>(sysconf(_SC_CLK_TCK));
  std::ifstream load("/proc/loadavg");
  load >> usage.load_1min;
  return usage;
}

double machine_memory_mb() {
  return static_cast<double>(sysconf(_SC_PHYS_PAGES)) * static_cast<double>(sysconf(_SC_PAGESIZE)) /
         (1 << 20);
}

}  // namespace multipanda

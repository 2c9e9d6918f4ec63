#include "experiments/beside_trace.hpp"

#include <algorithm>
#include <fstream>
#include <iterator>
#include <stdexcept>

#include <fmt/format.h>

#include "support/spelling.hpp"

namespace multipanda {
namespace {

namespace fs = std::filesystem;

// "CA-MA_2.npz": CA-MA; empty: another name.
std::string condition_of(const fs::path& file) {
  const std::string stem = file.stem().string();
  const auto last = stem.rfind('_');
  if (file.extension() != ".npz" || last == std::string::npos || last + 1 == stem.size() ||
      stem.find_first_not_of("0123456789", last + 1) != std::string::npos)
    return {};
  return stem.substr(0, last);
}

// The directory at the end of the zip archive names its parts. The page reads and checks them; this finds a
// wrong file before the conditions run.
void check_file(const std::string& said, const fs::path& file) {
  constexpr std::streamoff kDirectory = 1 << 16;
  std::ifstream in(file, std::ios::binary | std::ios::ate);
  if (!in || !fs::is_regular_file(file))
    throw std::invalid_argument(fmt::format("--beside {}: there is no file {}", said, file.string()));
  in.seekg(std::max<std::streamoff>(in.tellg() - std::streamoff{kDirectory}, 0));
  const std::string end{std::istreambuf_iterator<char>(in), {}};
  if (end.find("about.npy") == std::string::npos || end.find("stages_us.npy") == std::string::npos)
    throw std::invalid_argument(
        fmt::format("--beside {}: {} is not a measurement by the multimode controller (docs/ros2_control.md)",
                    said, file.string()));
}

}  // namespace

std::vector<BesideTrace> beside_traces(const std::vector<std::string>& named,
                                       const std::vector<std::string>& conditions) {
  std::vector<BesideTrace> traces;
  const auto runs = [&](const std::string& name) {
    return std::ranges::find(conditions, name) != conditions.end();
  };
  const auto add = [&](const std::string& said, const std::string& condition, const fs::path& file) {
    check_file(said, file);
    traces.push_back({condition, fs::absolute(file)});
  };
  for (const auto& text : named) {
    const auto equals = text.find('=');
    const bool says = equals != std::string::npos && !fs::exists(text);
    const fs::path path = says ? text.substr(equals + 1) : text;
    if (!says && fs::is_directory(path)) {
      std::vector<fs::path> files;
      for (const auto& entry : fs::directory_iterator(path))
        if (runs(condition_of(entry.path()))) files.push_back(entry.path());
      if (files.empty())
        throw std::invalid_argument(
            fmt::format("--beside {}: it has no file of a condition that runs now, such as {}_1.npz", text,
                        conditions.front()));
      std::ranges::sort(files);
      for (const auto& file : files) add(text, condition_of(file), file);
      continue;
    }
    const std::string condition = says ? text.substr(0, equals) : condition_of(path);
    if (condition.empty())
      throw std::invalid_argument(
          fmt::format("--beside {}: it does not say of which condition it is: --beside {}={}", text,
                      conditions.front(), text));
    if (!runs(condition))
      throw std::invalid_argument(fmt::format("--beside {}: no condition '{}' runs{}", text, condition,
                                              name_hint(condition, conditions, "there are none")));
    add(text, condition, path);
  }
  return traces;
}

}  // namespace multipanda

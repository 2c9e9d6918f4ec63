#pragma once

#include <cstdint>
#include <functional>
#include <map>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "python_bindings/controlled_world.hpp"
#include "scene/load.hpp"

namespace multipanda {

// Worlds of one scene, stepped together on threads. A world does not depend on the others or on the number of
// threads. One caller at a time.
class Batch {
 public:
  // `threads`: 0 means one per processor. Throws ConfigError, or std::invalid_argument for no world.
  Batch(const std::string& scene, std::size_t count, std::size_t threads);

  std::size_t count() const { return worlds_.size(); }
  std::size_t threads() const { return threads_; }
  const StateRow& layout() const { return *layout_; }
  const Scene& scene() const { return opened_.scene; }
  // The states of all worlds, a row each; fixed in memory.
  double* states() { return states_.data(); }
  ControlledWorld& world(std::size_t k) { return *worlds_[k]; }

  // These act on the worlds of `chosen` (one byte per world); the others do not change.
  void reset(std::span<const std::uint8_t> chosen, std::span<const WorldStart> starts);  // a start per world
  // Numbers of a request that are each world's own: by key, a row per world.
  struct Rows {
    const double* numbers;
    std::size_t size;  // of a row; a single number is given as such, not as a list
  };
  using OwnNumbers = std::map<std::string, Rows>;
  static nlohmann::json request_of(std::size_t k, nlohmann::json request, const OwnNumbers& own);
  // Sends each world the same request with its own numbers; refusal() returns what it refused.
  void command(std::span<const std::uint8_t> chosen, const nlohmann::json& request, const OwnNumbers& own);
  void step(std::span<const std::uint8_t> chosen, std::uint64_t cycles);
  void restore(std::size_t k, const SavedWorld& saved);

 private:
  // Does the work on threads, each world on one thread, and updates the states. Throws the first exception.
  void each(std::span<const std::uint8_t> chosen,
            const std::function<void(std::size_t, ControlledWorld&)>& work);

  OpenedScene opened_;
  std::unique_ptr<StateRow> layout_;
  std::optional<WorldParts> parts_;
  std::size_t threads_;
  std::vector<std::unique_ptr<ControlledWorld>> worlds_;
  std::vector<double> states_;
};

}  // namespace multipanda

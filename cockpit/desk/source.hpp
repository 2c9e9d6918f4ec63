#pragma once

#include <cstdint>
#include <functional>
#include <optional>
#include <span>
#include <string>
#include <variant>
#include <vector>

#include <nlohmann/json.hpp>

#include "core/types/time.hpp"

namespace multipanda::cockpit {

struct Reply {
  nlohmann::json answer;
  std::string numbers;  // a binary message after it; empty: none
};
// Asked for again until there is an answer.
using Later = std::function<std::optional<Reply>()>;

// Numbers of every nth cycle for one client.
struct Plot {
  std::vector<std::size_t> fields;  // of the source's record fields
  std::uint64_t every = 1;          // cycles
  std::uint64_t next = 0;           // the first record that was not looked at
};

// What a cockpit shows and commands: a run, a log, virtual arms. Used on the cockpit's thread only, except
// for construction and destruction.
class Source {
 public:
  virtual ~Source() = default;

  virtual nlohmann::json hello() = 0;               // everything but what concerns the connection
  virtual void update(HostTime now) = 0;            // takes what is new; called in every turn
  virtual std::string ended() const { return {}; }  // why nothing more will come; empty: it goes on

  // --- states ---
  virtual std::uint64_t newest() const = 0;                 // counts up with every state; 0: none yet
  virtual std::span<const double> state(HostTime now) = 0;  // the newest one, as hello's `state_fields`
  virtual nlohmann::json slow_state() = 0;                  // what is no number of it; null: nothing
  virtual std::uint64_t list_version() const = 0;
  virtual nlohmann::json list() = 0;
  // Those from number `from` on, which becomes the number of the next one.
  virtual std::vector<nlohmann::json> events(std::uint64_t& from) = 0;

  // --- plots ---
  // Throws RequestRefused.
  virtual Plot open_plot(const std::vector<std::string>& fields, std::uint64_t every) = 0;
  virtual nlohmann::json columns(const Plot& plot) const = 0;
  // Appends rows of f64: t_s, then the fields. Returns their number.
  virtual std::uint32_t rows(Plot& plot, std::string& out) = 0;

  // --- requests ---
  virtual std::vector<std::string> commands() const = 0;  // that ask() takes
  // A watcher may ask for it; it needs a hold.
  virtual bool is_open(const std::string& command) const = 0;
  virtual bool moves(const std::string& command) const = 0;
  virtual std::variant<Reply, Later> ask(const nlohmann::json& request) = 0;  // throws RequestRefused
  // Arms that 'stop' has stopped wait for 'resume'.
  virtual bool is_stopped() const { return false; }
  // The hold that moved inputs is over: they come to rest. `hold`: their controllets end, too.
  virtual void come_to_rest(bool hold) = 0;
};

}  // namespace multipanda::cockpit

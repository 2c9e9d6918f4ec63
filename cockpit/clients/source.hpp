#pragma once

#include <cstdint>
#include <functional>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <variant>
#include <vector>

#include <nlohmann/json.hpp>

#include "core/types/time.hpp"

namespace multipanda::cockpit {

struct Reply {
  nlohmann::json answer;
  std::string numbers;  // a binary message that follows it; empty: none
};
// Polled until there is an answer.
using Later = std::function<std::optional<Reply>()>;

// Numbers of every nth cycle for one client.
struct Plot {
  std::vector<std::size_t> fields;  // of the source's record fields
  std::uint64_t every = 1;          // cycles
  std::uint64_t next = 0;           // the next record to read
};

// What a cockpit shows and commands: a run, a log, virtual arms. Used on the cockpit's thread only, except
// for construction and destruction.
class Source {
 public:
  virtual ~Source() = default;

  virtual nlohmann::json hello() = 0;               // everything except data about the connection
  virtual void update(HostTime now) = 0;            // reads new data; called in every turn
  virtual std::string ended() const { return {}; }  // why no data will follow; empty: not ended

  // --- states ---
  virtual std::uint64_t newest() const = 0;                 // increases with every state; 0: none yet
  virtual std::span<const double> state(HostTime now) = 0;  // the newest state, in the order of hello's
                                                            // `state_fields`
  virtual nlohmann::json slow_state() = 0;                  // data that are not numbers of the state; null:
                                                            // none
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
  virtual std::vector<std::string> commands() const = 0;       // that ask() takes
  virtual bool is_open(const std::string& command) const = 0;  // a watcher may request it
  // It may move an arm, so it needs a hold. Throws RequestRefused.
  virtual bool moves(const nlohmann::json& request) const = 0;
  // Throws RequestRefused.
  virtual std::variant<Reply, Later> ask(const nlohmann::json& request, HostTime arrived) = 0;
  // Arms that 'stop' has stopped wait for 'resume'.
  virtual bool is_stopped() const { return false; }
  // The hold has ended: everything that it moved comes to rest. `hold`: its controllets end, too. Returns why
  // some of them end although the operator released the button; empty: none does.
  virtual std::string come_to_rest(bool hold) = 0;
};

// Binary messages (cockpit/WIRE.md): four u32, then f64; little-endian.
inline constexpr std::uint32_t kState = 1, kPlotRows = 2, kLogRows = 3;  // kinds

std::string state_frame(std::uint32_t number, std::span<const double> values);
// `rows`: the bytes of rows x columns f64.
std::string rows_frame(std::uint32_t kind, std::uint32_t number, std::uint32_t rows, std::uint32_t columns,
                       std::string_view bytes);

}  // namespace multipanda::cockpit

#pragma once

#include <memory>
#include <vector>

#include "cockpit/clients/source.hpp"
#include "cockpit/log/log_table.hpp"
#include "cockpit/run/state_view.hpp"

namespace multipanda::cockpit {

// One recorded log, or two in comparison, from which pages request parts.
class LogSource final : public Source {
 public:
  static constexpr std::size_t kMostStates = 600, kMostColumnRows = 20000, kMostNumbers = 1'000'000;

  explicit LogSource(std::vector<std::unique_ptr<LogTable>> logs);

  nlohmann::json hello() override;
  void update(HostTime) override {}
  std::uint64_t newest() const override { return 0; }
  std::span<const double> state(HostTime) override { return {}; }
  nlohmann::json slow_state() override { return nullptr; }
  std::uint64_t list_version() const override { return 1; }
  nlohmann::json list() override;
  std::vector<nlohmann::json> events(std::uint64_t&) override { return {}; }
  Plot open_plot(const std::vector<std::string>& fields, std::uint64_t every) override;
  nlohmann::json columns(const Plot&) const override { return nlohmann::json::array(); }
  std::uint32_t rows(Plot&, std::string&) override { return 0; }
  std::vector<std::string> commands() const override;
  bool is_open(const std::string&) const override { return true; }
  bool moves(const nlohmann::json&) const override { return false; }
  std::variant<Reply, Later> ask(const nlohmann::json& request, HostTime arrived) override;
  std::string come_to_rest(bool) override { return {}; }

 private:
  struct Log {
    std::unique_ptr<LogTable> table;
    std::unique_ptr<StateView> view;
  };
  Reply states(Log& log, const std::vector<std::size_t>& rows);
  Reply columns_of(Log& log, const std::vector<std::string>& names, const std::vector<std::size_t>& rows);

  std::vector<Log> logs_;
  std::uint32_t slices_ = 0;
};

}  // namespace multipanda::cockpit

#pragma once

#include <future>
#include <map>
#include <memory>
#include <string>
#include <vector>

#include "cockpit/clients/source.hpp"
#include "cockpit/run/record_view.hpp"
#include "cockpit/run/state_view.hpp"
#include "runtime/live_input/request_handler.hpp"
#include "runtime/session.hpp"

namespace multipanda::cockpit {

// A run: its shared records, and the requests of its socket, with the same refusals.
class RunSource final : public Source {
 public:
  // `session` (with share_records) must outlive this; `objects` may be nullptr. Throws std::runtime_error if
  // the run shares no records.
  explicit RunSource(Session& session);

  nlohmann::json hello() override;
  void update(HostTime now) override;
  std::uint64_t newest() const override { return records_.count(); }
  std::span<const double> state(HostTime now) override;
  nlohmann::json slow_state() override;
  std::uint64_t list_version() const override { return list_version_; }
  nlohmann::json list() override;
  std::vector<nlohmann::json> events(std::uint64_t& from) override { return records_.events(from); }
  Plot open_plot(const std::vector<std::string>& fields, std::uint64_t every) override {
    return records_.open_plot(fields, every);
  }
  nlohmann::json columns(const Plot& plot) const override { return records_.columns(plot); }
  std::uint32_t rows(Plot& plot, std::string& out) override { return records_.rows(plot, out); }
  std::vector<std::string> commands() const override;
  bool is_open(const std::string& command) const override;
  bool moves(const nlohmann::json& request) const override;
  std::variant<Reply, Later> ask(const nlohmann::json& request, HostTime arrived) override;
  bool is_stopped() const override { return !session_.modes().stopped().empty(); }
  std::string come_to_rest(bool hold) override;

 private:
  void look_at_status(HostTime now);
  std::string look_at_stops();  // what was refused now
  bool moves(const Request& request) const;
  bool moves_parameter(const Request& request) const;
  void note_moved(const nlohmann::json& request, const std::shared_ptr<RequestHandler::Pending>& pending);

  Session& session_;
  const LiveInputContext input_;
  RequestHandler handler_;
  RecordView records_;
  StateView view_;
  MovedInputs moved_;
  // Motions of grippers that this hold has begun.
  std::vector<std::pair<ArmIndex, std::shared_ptr<RequestHandler::Pending>>> gripping_;
  std::vector<std::pair<ArmIndex, std::future<RequestAnswer>>> stopping_;
  std::map<ArmIndex, std::string> not_stopped_;  // grippers that refused to stop
  std::uint64_t list_version_ = 1;
  HostTime next_status_;
  RunStatus status_;
  std::vector<StateView::More> more_;
  LatestState::Snapshot snapshot_;
  std::vector<std::optional<Pose>> poses_;
};

}  // namespace multipanda::cockpit

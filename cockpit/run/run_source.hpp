#pragma once

#include <memory>
#include <set>
#include <string>
#include <vector>

#include "cockpit/desk/source.hpp"
#include "cockpit/run/moved_inputs.hpp"
#include "cockpit/run/object_poses.hpp"
#include "cockpit/run/state_view.hpp"
#include "runtime/cycle_histogram.hpp"
#include "runtime/live_input/request_handler.hpp"
#include "runtime/session.hpp"

namespace multipanda::cockpit {

// A run: its shared records, and the requests that its socket takes, with the same refusals.
class RunSource final : public Source {
 public:
  // `session` (with share_records) must outlive this; `objects` may be nullptr. Throws std::runtime_error if
  // the run shares no records.
  RunSource(Session& session, ObjectPoses* objects);

  nlohmann::json hello() override;
  void update(HostTime now) override;
  std::uint64_t newest() const override { return records_; }
  std::span<const double> state(HostTime now) override;
  nlohmann::json slow_state() override;
  std::uint64_t list_version() const override { return list_version_; }
  nlohmann::json list() override;
  std::vector<nlohmann::json> events(std::uint64_t& from) override;
  Plot open_plot(const std::vector<std::string>& fields, std::uint64_t every) override;
  nlohmann::json columns(const Plot& plot) const override;
  std::uint32_t rows(Plot& plot, std::string& out) override;
  std::vector<std::string> commands() const override;
  bool is_open(const std::string& command) const override;
  bool moves(const std::string& command) const override;
  std::variant<Reply, Later> ask(const nlohmann::json& request) override;
  void come_to_rest(bool hold) override;

 private:
  void look_at_status(HostTime now);
  void note_moved(const nlohmann::json& request, std::uint64_t ticket);
  nlohmann::json histogram() const;

  Session& session_;
  ObjectPoses* objects_;
  const LiveInputContext input_;
  RequestHandler handler_;
  RecordReader reader_;
  StateView view_;
  MovedInputs moved_;
  RecordReader::Field cycle_, t_ns_, start_ns_, total_ns_;
  RecordReader::Record record_, row_;
  std::uint64_t records_ = 0;  // seen
  std::uint64_t events_ = 0;   // seen
  std::uint64_t list_version_ = 1;
  HostTime next_status_;
  HostTime moved_on_{};  // when the newest records had another time than those before
  RunStatus status_;
  std::vector<StateView::More> more_;
  LatestState::Snapshot snapshot_;
  std::vector<std::optional<Pose>> poses_;
  std::vector<std::uint64_t> bins_;  // of cycle times
  CycleHistogram times_;
};

}  // namespace multipanda::cockpit

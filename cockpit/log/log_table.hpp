#pragma once

#include <filesystem>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include <nlohmann/json.hpp>

#include "cockpit/clients/source.hpp"
#include "cockpit/run/state_view.hpp"
#include "core/model/model_terms.hpp"
#include "logs/mcap_reader.hpp"
#include "logs/messages.hpp"
#include "runtime/shared_records/shared_records.hpp"
#include "scene/scene.hpp"

namespace multipanda::cockpit {

// A log as rows of the fields of shared records, so that it is shown like a run. Memory is bounded for any
// length: at kMostRows rows every second one is dropped, and so on.
class LogTable {
 public:
  static constexpr std::size_t kMostRows = 65536;
  static constexpr std::size_t kMostEvents = 20000;

  // Reads all of it. Throws std::runtime_error: no log, or one whose scene cannot be built.
  explicit LogTable(const std::filesystem::path& log, std::size_t most_rows = kMostRows);

  const std::string& name() const { return name_; }
  const Scene& scene() const { return scene_; }
  const std::vector<std::shared_ptr<const ArmModel>>& models() const { return models_; }
  const std::vector<RecordReader::Field>& fields() const { return fields_; }
  const nlohmann::json& layout() const { return layout_; }  // arms, controllets with inputs and outputs
  const nlohmann::json& events() const { return events_; }  // same format as a run's
  const std::vector<std::string>& owners() const { return owners_; }
  std::size_t rows() const { return t_.size(); }
  std::uint64_t every() const { return every_; }  // cycles per row
  double t_s(std::size_t row) const { return t_[row]; }
  std::size_t row_at(double t_s) const;  // the last one not after it, or the first
  double value(std::size_t row, const RecordReader::Field& field, std::size_t k) const;
  RecordReader::Record record(std::size_t row) const;
  // Active frames at a row, per arm.
  std::vector<ArmFrames> frames(std::size_t row) const;
  // Poses of the scene's objects, in its order. None: fixed, or not in the log.
  std::vector<std::optional<Pose>> objects(std::size_t row) const;

 private:
  struct Arm {
    std::size_t joints = 0;
    // Place and count of a field in a row, by its name without the arm.
    std::map<std::string, std::pair<std::size_t, std::size_t>> at;
    std::unique_ptr<ModelTerms> terms;
    ArmFrames frames;
    std::vector<std::pair<double, ArmFrames>> changes;  // from this time on
    bool stopped = false;
    std::optional<msg::ArmReport> report;  // the newest one, since logs may contain fewer
  };

  void begin(const McapReader& reader);
  void lay_out();
  void take(const McapReader::Message& message);
  void take_event(const McapReader::Message& message);
  void take_numbers(const McapReader::Message& message);
  void take_object(const McapReader::Message& message);
  void add_event(std::uint64_t cycle, double t, const std::string& kind, const std::string& arm,
                 const std::string& text);
  void begin_row(std::int64_t t_ns);
  void end_row();
  void thin();
  Arm& arm(const std::string& name);
  void put(std::size_t at, double value) { row_[at] = static_cast<float>(value); }
  void put(std::size_t at, const std::vector<double>& values, std::size_t most);
  void put(const Arm& of, const std::string& field, const std::vector<double>& values);
  void put_quantities(const Arm& of, const auto& message);
  void put_output(const std::string& instance, const std::string& output, const std::vector<double>& values);

  const std::size_t most_;
  std::string name_;
  Scene scene_;
  std::vector<std::shared_ptr<const ArmModel>> models_;
  nlohmann::json layout_, events_ = nlohmann::json::array();
  std::vector<std::string> owners_;
  std::map<std::string, std::uint16_t> owner_of_;
  std::vector<RecordReader::Field> fields_;
  std::map<std::string, std::pair<std::size_t, std::size_t>> places_;  // of a field in a row: number, count
  std::map<std::string, Arm> arms_;
  struct Object {
    std::size_t at = 0;           // in a row: 7 numbers as write_pose()
    std::array<double, 7> now{};  // the newest one
  };
  void put_object(const Object& object);
  std::map<std::string, Object> objects_;  // free ones
  std::size_t width_ = 0;

  std::vector<double> t_, cycles_;
  std::vector<float> values_;  // rows
  std::vector<float> row_;     // being read
  std::int64_t row_ns_ = -1;
  double row_cycle_ = 0;
  bool kept_ = false;
  std::uint64_t every_ = 1, seen_ = 0;  // cycles
};

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

#pragma once

#include <functional>
#include <string>
#include <vector>

#include <nlohmann/json.hpp>

#include "cockpit/clients/source.hpp"
#include "core/rt/cycle_histogram.hpp"
#include "runtime/shared_records/shared_records.hpp"

namespace multipanda::cockpit {

// Data for pages from shared records: the newest record, plots, events, cycle times. Cockpit's thread.
class RecordView {
 public:
  explicit RecordView(int file);  // of shared records; throws std::runtime_error

  // Reads new data; `see` gets every new event.
  void update(HostTime now, const std::function<void(const nlohmann::json& event)>& see = {});

  const std::vector<RecordReader::Field>& fields() const { return reader_.fields(); }
  const RecordReader& reader() const { return reader_; }
  std::uint64_t count() const { return records_; }
  const RecordReader::Record& newest() const { return record_; }  // empty: none yet
  double since_s(HostTime now) const;                             // age of the newest one; 0: none
  double still_s(HostTime now) const;  // how long the loop's time has not advanced (in a pause cycles
                                       // continue)

  nlohmann::json field_list() const;  // [name, count] of each
  nlohmann::json names() const;       // behind numbers: modes, controllets, errors, interventions
  nlohmann::json cycle_times_us() const;
  nlohmann::json histogram() const;
  std::vector<nlohmann::json> events(std::uint64_t& from) const;
  Plot open_plot(const std::vector<std::string>& fields, std::uint64_t every) const;  // throws RequestRefused
  nlohmann::json columns(const Plot& plot) const;
  std::uint32_t rows(Plot& plot, std::string& out);

 private:
  RecordReader reader_;
  RecordReader::Field t_ns_, start_ns_, total_ns_;
  RecordReader::Record record_, row_;
  std::uint64_t records_ = 0, events_ = 0;  // seen
  HostTime moved_on_{};                     // when the loop's time last changed
  std::vector<std::uint64_t> bins_;         // of cycle times
  CycleHistogram times_;
};

// What to do about each error of an arm: [{error, cure}].
nlohmann::json cures_of(std::uint64_t errors);

}  // namespace multipanda::cockpit

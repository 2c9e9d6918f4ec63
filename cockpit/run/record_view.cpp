#include "cockpit/run/record_view.hpp"

#include <algorithm>
#include <cmath>

#include "arm_interface/arm_error.hpp"
#include "common/text.hpp"
#include "runtime/error_report.hpp"
#include "runtime/live_input/json_fields.hpp"

namespace multipanda::cockpit {
namespace {

using nlohmann::json;

constexpr std::size_t kPerDecade = 12, kDecades = 4;  // bins of cycle times, from 1 us
constexpr std::uint32_t kMostRows = 512;              // of a plot in one message

RecordReader::Field field_of(const RecordReader& reader, const char* name) {
  const auto* field = reader.find(name);
  if (field == nullptr) throw std::runtime_error(std::string("the records have no field ") + name);
  return *field;
}

std::size_t bin_of(double us) {
  if (!(us >= 1)) return 0;
  const double k = std::floor(std::log10(us) * kPerDecade + 1e-9);
  return std::min<std::size_t>(kPerDecade * kDecades, static_cast<std::size_t>(k)) + 1;
}

}  // namespace

RecordView::RecordView(int file)
    : reader_(file),
      t_ns_(field_of(reader_, "t_ns")),
      start_ns_(field_of(reader_, "start_ns")),
      total_ns_(field_of(reader_, "total_ns")),
      bins_(kPerDecade * kDecades + 2) {}

void RecordView::update(HostTime now, const std::function<void(const json&)>& see) {
  const std::uint64_t count = reader_.records();
  for (std::uint64_t n = std::max(records_, reader_.oldest_record()); n < count; ++n) {
    if (!reader_.read(n, row_)) continue;
    const double ns = RecordReader::number(row_, total_ns_);
    times_.add(static_cast<std::int64_t>(ns));
    ++bins_[bin_of(1e-3 * ns)];
    if (record_.empty() || RecordReader::number(row_, t_ns_) != RecordReader::number(record_, t_ns_))
      moved_on_ = now;
    record_.swap(row_);
  }
  records_ = count;
  for (std::uint64_t n = std::max(events_, reader_.oldest_event()); n < reader_.events(); ++n) {
    const auto event = reader_.event(n);
    events_ = n + 1;
    if (!event || !see) continue;
    if (const json text = json::parse(event->text, nullptr, false); text.is_object()) see(text);
  }
}

double RecordView::since_s(HostTime now) const {
  return record_.empty() ? 0
                         : 1e-9 * (static_cast<double>(now.ns) - RecordReader::number(record_, start_ns_));
}

double RecordView::still_s(HostTime now) const { return record_.empty() ? 0 : seconds(now - moved_on_); }

json RecordView::field_list() const {
  json fields = json::array();
  for (const auto& field : reader_.fields()) fields.push_back({field.name, field.count});
  return fields;
}

json RecordView::names() const {
  const json table = json::parse(reader_.table());
  return {{"modes", table.at("modes")},
          {"controllets", table.at("controllets")},
          {"errors", table.at("errors")},
          {"interventions", table.at("interventions")}};
}

json RecordView::cycle_times_us() const {
  const auto us = [&](double share) { return 1e-3 * static_cast<double>(times_.percentile(share)); };
  return {{"median", us(0.5)},
          {"p99", us(0.99)},
          {"p999", us(0.999)},
          {"worst", 1e-3 * static_cast<double>(times_.max())}};
}

std::vector<json> RecordView::events(std::uint64_t& from) const {
  std::vector<json> all;
  for (std::uint64_t n = std::max(from, reader_.oldest_event()); n < events_; ++n) {
    const auto event = reader_.event(n);
    if (!event) continue;
    json text = json::parse(event->text, nullptr, false);
    if (!text.is_object()) continue;
    text["cycle"] = event->cycle;
    text["t_s"] = event->t.seconds();
    all.push_back(std::move(text));
  }
  from = events_;
  return all;
}

Plot RecordView::open_plot(const std::vector<std::string>& fields, std::uint64_t every) const {
  Plot plot{.fields = {}, .every = every, .next = reader_.oldest_record()};
  for (const std::string& name : fields) {
    const auto* field = reader_.find(name);
    if (field == nullptr) {
      std::vector<std::string> names;
      for (const auto& known : reader_.fields()) names.push_back(known.name);
      throw RequestRefused("malformed", "plot: there is no field '" + name.substr(0, 100) + "'" +
                                            name_hint(name, names, "there are none"));
    }
    plot.fields.push_back(static_cast<std::size_t>(field - reader_.fields().data()));
  }
  return plot;
}

json RecordView::columns(const Plot& plot) const {
  json columns = json::array();
  for (const std::size_t i : plot.fields)
    columns.push_back({reader_.fields()[i].name, reader_.fields()[i].count});
  return columns;
}

std::uint32_t RecordView::rows(Plot& plot, std::string& out) {
  std::uint32_t count = 0;
  plot.next = std::max(plot.next, reader_.oldest_record());
  const auto put = [&](double value) { out.append(reinterpret_cast<const char*>(&value), sizeof(value)); };
  for (; plot.next < records_ && count < kMostRows; ++plot.next) {
    if (plot.next % plot.every != 0 || !reader_.read(plot.next, row_)) continue;
    put(1e-9 * RecordReader::number(row_, t_ns_));
    for (const std::size_t i : plot.fields) {
      const auto& field = reader_.fields()[i];
      for (std::size_t k = 0; k < field.count; ++k) put(RecordReader::number(row_, field, k));
    }
    ++count;
  }
  return count;
}

json RecordView::histogram() const {
  json edges = json::array();
  edges.push_back(0);
  for (std::size_t k = 0; k <= kPerDecade * kDecades; ++k)
    edges.push_back(std::pow(10, static_cast<double>(k) / kPerDecade));
  edges.push_back(nullptr);  // open
  return {{"ok", true}, {"edges_us", edges}, {"counts", bins_}};
}

json cures_of(std::uint64_t errors) {
  json cures = json::array();
  for (std::size_t bit = 0; bit < kArmErrorCount; ++bit) {
    if ((errors >> bit & 1u) == 0) continue;
    const auto error = static_cast<ArmError>(bit);
    cures.push_back({{"error", to_string(error)}, {"cure", cure(error)}});
  }
  return cures;
}

}  // namespace multipanda::cockpit

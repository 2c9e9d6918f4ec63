#include "cockpit/run/run_source.hpp"

#include <algorithm>
#include <cmath>

#include "cockpit/view/scene_text.hpp"
#include "device/arm_error.hpp"
#include "runtime/error_report.hpp"
#include "runtime/live_input/backend_requests.hpp"
#include "support/spelling.hpp"

namespace multipanda::cockpit {
namespace {

using nlohmann::json;

constexpr double kStill = 0.25;  // the loop stands still [s]
constexpr std::chrono::milliseconds kStatusPeriod{100};
constexpr std::size_t kPerDecade = 12, kDecades = 4;  // bins of cycle times, from 1 us
constexpr std::uint32_t kMostRows = 512;              // of a plot in one message

const std::vector<std::string> kCommands = {"list",      "state", "switch", "feature", "parameter",
                                            "reference", "stop",  "resume", "episode", "histogram"};

int file_of(const LiveInputContext& input) {
  if (input.records == nullptr)
    throw std::runtime_error("this run shares no records, so a cockpit cannot show it: see its messages");
  return input.records->memory().file();
}

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

RunSource::RunSource(Session& session, ObjectPoses* objects)
    : session_(session),
      objects_(objects),
      input_(session.live_input()),
      handler_(input_),
      reader_(file_of(input_)),
      view_(session.scene(), session.models(), reader_.fields()),
      moved_(session.modes()),
      cycle_(field_of(reader_, "cycle")),
      t_ns_(field_of(reader_, "t_ns")),
      start_ns_(field_of(reader_, "start_ns")),
      total_ns_(field_of(reader_, "total_ns")),
      more_(session.models().size()),
      bins_(kPerDecade * kDecades + 2) {}

json RunSource::hello() {
  const Scene& scene = session_.scene();
  json arms = describe_arms(scene);
  bool simulated = true;
  for (ArmIndex i = 0; i < arms.size(); ++i) {
    const Capabilities can = session_.backend().capabilities(i);
    simulated = simulated && can.simulated;
    const bool connected = session_.backend().connection(i).has_value();
    arms[i].update({{"kind", !connected      ? "simulated"
                             : can.simulated ? "virtual"
                                             : "real"},
                    {"gripper", can.has_gripper},
                    {"vacuum", can.has_vacuum}});
  }
  const json table = json::parse(reader_.table());
  json fields = json::array();
  for (const auto& field : reader_.fields()) fields.push_back({field.name, field.count});
  json list = handler_.list();
  list.erase("ok");
  return {{"version", list["version"]},
          {"kind", "run"},
          {"scene",
           {{"name", scene.name},
            {"description", scene.description},
            {"backend", session_.backend_description()},
            {"simulated", simulated},
            {"duration_s", session_.duration_s()},
            {"arms", arms},
            {"bodies", view_.bodies()}}},
          {"list", list},
          {"state_fields", view_.fields()},
          {"record_fields", fields},
          {"names",
           {{"modes", table.at("modes")},
            {"controllets", table.at("controllets")},
            {"errors", table.at("errors")},
            {"interventions", table.at("interventions")}}},
          {"commands", commands()},
          {"logs", json::array()}};
}

void RunSource::update(HostTime now) {
  const std::uint64_t count = reader_.records();
  for (std::uint64_t n = std::max(records_, reader_.oldest_record()); n < count; ++n) {
    if (!reader_.read(n, row_)) continue;
    const double ns = RecordReader::number(row_, total_ns_);
    times_.add(static_cast<std::int64_t>(ns));
    ++bins_[bin_of(1e-3 * ns)];
    const double t_ns = RecordReader::number(row_, t_ns_);
    // While a simulation is paused, cycles go on and the time of the loop stands still.
    if (record_.empty() || t_ns != RecordReader::number(record_, t_ns_)) moved_on_ = now;
    record_.swap(row_);
  }
  records_ = count;
  for (std::uint64_t n = std::max(events_, reader_.oldest_event()); n < reader_.events(); ++n) {
    const auto event = reader_.event(n);
    events_ = n + 1;
    if (!event) continue;
    const json text = json::parse(event->text, nullptr, false);
    const std::string kind = text.is_object() ? text.value("kind", "") : "";
    if (kind == "parameter_set" || kind == "feature_set" || kind == "switched" || kind == "controllet")
      ++list_version_;
  }
  look_at_status(now);
}

void RunSource::look_at_status(HostTime now) {
  if (now.ns < next_status_.ns) return;
  next_status_ = {now.ns + std::chrono::nanoseconds(kStatusPeriod).count()};
  status_ = session_.status();
  input_.latest->copy(snapshot_);
  for (std::size_t i = 0; i < more_.size() && i < status_.arms.size(); ++i) {
    if (i < snapshot_.arms.size()) more_[i].frames = snapshot_.arms[i].frames;
    more_[i].tracking_error = status_.arms[i].tracking_error.value_or(std::nan(""));
    more_[i].torque_use = status_.arms[i].torque_use;
  }
}

std::span<const double> RunSource::state(HostTime now) {
  if (record_.empty()) return {};
  if (objects_ != nullptr) objects_->read(poses_);
  const double since = 1e-9 * (static_cast<double>(now.ns) - RecordReader::number(record_, start_ns_));
  return view_.compute(record_, since, more_, poses_);
}

json RunSource::slow_state() {
  json state = handler_.state();
  state["paused"] = !record_.empty() && seconds(host_now() - moved_on_) > kStill;
  const auto us = [&](double share) { return 1e-3 * static_cast<double>(times_.percentile(share)); };
  state["cycle_times_us"] = {{"median", us(0.5)},
                             {"p99", us(0.99)},
                             {"p999", us(0.999)},
                             {"worst", 1e-3 * static_cast<double>(times_.max())}};
  for (std::size_t i = 0; i < state["arms"].size(); ++i) {
    json& arm = state["arms"][i];
    json cures = json::array();
    const auto errors = arm["errors"].get<std::uint64_t>();
    for (std::size_t bit = 0; bit < kArmErrorCount; ++bit) {
      if ((errors >> bit & 1u) == 0) continue;
      const auto error = static_cast<ArmError>(bit);
      cures.push_back({{"error", to_string(error)}, {"cure", cure(error)}});
    }
    arm["cures"] = cures;
    if (i < status_.arms.size()) arm["tracking_unit"] = status_.arms[i].tracking_unit;
  }
  return state;
}

json RunSource::list() {
  json list = handler_.list();
  list.erase("ok");
  return list;
}

std::vector<json> RunSource::events(std::uint64_t& from) {
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

// --- plots ---

Plot RunSource::open_plot(const std::vector<std::string>& fields, std::uint64_t every) {
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

json RunSource::columns(const Plot& plot) const {
  json columns = json::array();
  for (const std::size_t i : plot.fields)
    columns.push_back({reader_.fields()[i].name, reader_.fields()[i].count});
  return columns;
}

std::uint32_t RunSource::rows(Plot& plot, std::string& out) {
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

json RunSource::histogram() const {
  json edges = json::array();
  edges.push_back(0);
  for (std::size_t k = 0; k <= kPerDecade * kDecades; ++k)
    edges.push_back(std::pow(10, static_cast<double>(k) / kPerDecade));
  edges.push_back(nullptr);  // open
  return {{"ok", true}, {"edges_us", edges}, {"counts", bins_}};
}

// --- requests ---

std::vector<std::string> RunSource::commands() const {
  std::vector<std::string> all = kCommands;
  const auto backend = backend_request_names();
  all.insert(all.end(), backend.begin(), backend.end());
  return all;
}

bool RunSource::is_open(const std::string& command) const {
  return command == "list" || command == "state" || command == "histogram" || command == "stop";
}

bool RunSource::moves(const std::string& command) const { return command == "reference"; }

std::variant<Reply, Later> RunSource::ask(const json& request) {
  const std::string word = request.at("do").get<std::string>();
  if (word == "histogram") return Reply{.answer = histogram(), .numbers = {}};
  auto pending = std::make_shared<RequestHandler::Pending>();
  const HostTime received = host_now();
  auto at_once = handler_.begin(request, *pending);
  const bool accepted = !at_once || at_once->value("ok", false);
  if (word == "reference" && accepted) note_moved(request, pending->ticket);
  const auto finish = [word, received](json answer) {
    if (word == "stop") answer["received_ns"] = received.ns;
    return Reply{.answer = std::move(answer), .numbers = {}};
  };
  if (at_once) return finish(std::move(*at_once));
  return Later([this, pending, finish]() -> std::optional<Reply> {
    auto done = handler_.poll(*pending);
    if (!done) return {};
    return finish(std::move(*done));
  });
}

void RunSource::note_moved(const json& request, std::uint64_t ticket) {
  MultimodeController& modes = session_.modes();
  const InstanceIndex instance = modes.find(request.at("controllet").get<std::string>());
  moved_.add(instance, modes.instance(instance).find_input(request.at("input").get<std::string>()));
  if (ticket != 0) moved_.add_ticket(ticket);
}

void RunSource::come_to_rest(bool hold) { moved_.come_to_rest(reader_, hold); }

}  // namespace multipanda::cockpit

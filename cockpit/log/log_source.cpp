#include <algorithm>
#include <cmath>

#include "arm_interface/arm_error.hpp"
#include "cockpit/clients/source.hpp"
#include "cockpit/log/log_table.hpp"
#include "cockpit/view/scene_bodies.hpp"
#include "common/text.hpp"
#include "core/state/arm_state.hpp"
#include "runtime/live_input/json_fields.hpp"

namespace multipanda::cockpit {
namespace {

using nlohmann::json;

void put(std::string& out, double value) { out.append(reinterpret_cast<const char*>(&value), sizeof(value)); }

json names_of(const LogTable& log) {
  json modes = json::array(), errors = json::array();
  for (int mode = 0; mode <= static_cast<int>(ArmMode::disconnected); ++mode)
    modes.push_back(to_string(static_cast<ArmMode>(mode)));
  for (std::size_t bit = 0; bit < kArmErrorCount; ++bit)
    errors.push_back(to_string(static_cast<ArmError>(bit)));
  return {
      {"modes", modes}, {"controllets", log.owners()}, {"errors", errors}, {"interventions", json::array()}};
}

json fields_of(const LogTable& log) {
  json fields = json::array();
  for (const auto& field : log.fields()) fields.push_back({field.name, field.count});
  return fields;
}

// Rows between two times, thinned evenly to `most`.
std::vector<std::size_t> between(const LogTable& log, double from, double to, std::size_t most) {
  const std::size_t first = log.row_at(from), last = log.row_at(to);
  const std::size_t count = last - first + 1;
  const std::size_t step = (count + most - 1) / most;
  std::vector<std::size_t> rows;
  for (std::size_t row = first; row <= last; row += step) rows.push_back(row);
  return rows;
}

}  // namespace

LogSource::LogSource(std::vector<std::unique_ptr<LogTable>> logs) {
  for (auto& table : logs) {
    auto view = std::make_unique<StateView>(table->scene(), table->models(), table->fields());
    logs_.push_back({std::move(table), std::move(view)});
  }
}

json LogSource::hello() {
  const LogTable& first = *logs_.front().table;
  json logs = json::array();
  for (const Log& log : logs_) {
    const LogTable& table = *log.table;
    logs.push_back({{"name", table.name()},
                    {"t_from_s", table.t_s(0)},
                    {"t_to_s", table.t_s(table.rows() - 1)},
                    {"rows", table.rows()},
                    {"every", table.every()},
                    {"events", table.events()},
                    {"state_fields", log.view->fields()},
                    {"record_fields", fields_of(table)},
                    {"names", names_of(table)}});
  }
  json arms = describe_arms(first.scene());
  for (auto& arm : arms) arm.update({{"kind", "recorded"}, {"gripper", false}, {"vacuum", false}});
  return {{"version", MULTIPANDA_VERSION},
          {"kind", "log"},
          {"scene",
           {{"name", first.scene().name},
            {"description", first.scene().description},
            {"backend", "log"},
            {"simulated", false},
            {"duration_s", 0},
            {"arms", arms},
            {"bodies", logs_.front().view->bodies()}}},
          {"list", list()},
          {"state_fields", logs_.front().view->fields()},
          {"record_fields", fields_of(first)},
          {"names", names_of(first)},
          {"commands", commands()},
          {"logs", logs}};
}

json LogSource::list() {
  json controllets = json::array();
  for (json instance : logs_.front().table->layout().at("instances")) {
    instance.update({{"active", false}, {"features", json::array()}, {"parameters", json::array()}});
    controllets.push_back(std::move(instance));
  }
  return {{"controllets", controllets}};
}

Plot LogSource::open_plot(const std::vector<std::string>&, std::uint64_t) {
  throw RequestRefused("malformed", "plot: a log is not a run; request its columns with 'log_columns'");
}

std::vector<std::string> LogSource::commands() const {
  return {"log_state", "log_states", "log_columns", "list"};
}

std::variant<Reply, Later> LogSource::ask(const json& request, HostTime /*arrived*/) {
  const JsonFields fields(request, request.at("do").get<std::string>());
  const std::string& word = fields.what();
  if (word == "list") {
    fields.allow({"id", "do"});
    json answer = list();
    answer["ok"] = true;
    return Reply{.answer = std::move(answer), .numbers = {}};
  }
  const double number = fields.number("log", 0);
  if (!(number >= 0 && number < static_cast<double>(logs_.size())) || number != std::floor(number))
    fields.expected("log", "the number of a log, 0 to " + std::to_string(logs_.size() - 1));
  Log& log = logs_[static_cast<std::size_t>(number)];
  if (word == "log_state") {
    fields.allow({"id", "do", "log", "t_s"});
    return states(log, {log.table->row_at(fields.number("t_s"))});
  }
  const double from = fields.number("from_s"), to = fields.number("to_s");
  if (!(from <= to)) fields.expected("to_s", "a time not before from_s");
  if (word == "log_states") {
    fields.allow({"id", "do", "log", "from_s", "to_s", "rate_hz"});
    const double rate = fields.number("rate_hz", 60);
    if (!(rate > 0 && rate <= 1000)) fields.expected("rate_hz", "above 0, at most 1000");
    const double count = std::clamp((to - from) * rate, 1.0, static_cast<double>(kMostStates));
    return states(log, between(*log.table, from, to, static_cast<std::size_t>(count)));
  }
  fields.allow({"id", "do", "log", "fields", "from_s", "to_s", "rows"});
  const double most = fields.number("rows", 2000);
  if (!(most >= 1 && most <= static_cast<double>(kMostColumnRows))) fields.expected("rows", "1 to 20000");
  return columns_of(log, fields.texts("fields"),
                    between(*log.table, from, to, static_cast<std::size_t>(most)));
}

Reply LogSource::states(Log& log, const std::vector<std::size_t>& rows) {
  std::string out;
  std::uint32_t width = 0;
  for (const std::size_t row : rows) {
    std::vector<StateView::More> more;
    for (const ArmFrames& frames : log.table->frames(row))
      more.push_back({.frames = frames, .tracking_error = std::nan(""), .torque_use = std::nan("")});
    const auto values = log.view->compute(log.table->record(row), 0, more, log.table->objects(row));
    width = static_cast<std::uint32_t>(1 + values.size());
    put(out, log.table->t_s(row));
    out.append(reinterpret_cast<const char*>(values.data()), values.size_bytes());
  }
  const std::uint32_t slice = ++slices_;
  return {.answer = {{"ok", true}, {"slice", slice}, {"columns", log.view->fields()}},
          .numbers = rows_frame(kLogRows, slice, static_cast<std::uint32_t>(rows.size()), width, out)};
}

Reply LogSource::columns_of(Log& log, const std::vector<std::string>& names,
                            const std::vector<std::size_t>& rows) {
  std::vector<const RecordReader::Field*> fields;
  json columns = json::array();
  std::size_t width = 1;
  for (const std::string& name : names) {
    const auto found = std::ranges::find(log.table->fields(), name, &RecordReader::Field::name);
    if (found == log.table->fields().end()) {
      std::vector<std::string> known;
      for (const auto& field : log.table->fields()) known.push_back(field.name);
      throw RequestRefused("malformed", "log_columns: there is no field '" + name.substr(0, 100) + "'" +
                                            name_hint(name, known, "there are none"));
    }
    fields.push_back(&*found);
    columns.push_back({found->name, found->count});
    width += found->count;
  }
  if (width * rows.size() > kMostNumbers)
    throw RequestRefused("malformed", "log_columns: more than 1000000 numbers: request fewer rows or fields");
  std::string out;
  for (const std::size_t row : rows) {
    put(out, log.table->t_s(row));
    for (const auto* field : fields) {
      for (std::size_t k = 0; k < field->count; ++k) put(out, log.table->value(row, *field, k));
    }
  }
  const std::uint32_t slice = ++slices_;
  return {.answer = {{"ok", true}, {"slice", slice}, {"columns", columns}},
          .numbers = rows_frame(kLogRows, slice, static_cast<std::uint32_t>(rows.size()),
                                static_cast<std::uint32_t>(width), out)};
}

}  // namespace multipanda::cockpit

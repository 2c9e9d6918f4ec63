#include "cockpit/desk/desk.hpp"

#include <algorithm>
#include <cstring>
#include <utility>

#include "cockpit/desk/frames.hpp"
#include "runtime/live_input/json_fields.hpp"
#include "support/spelling.hpp"

namespace multipanda::cockpit {
namespace {

using nlohmann::json;
using std::chrono::milliseconds;
using std::chrono::nanoseconds;

constexpr double kSlowest = 0.1, kFastest = 120, kUsual = 60;  // states [Hz]
constexpr milliseconds kSlowPeriod{200}, kListPeriod{200}, kPlotPeriod{20};
constexpr milliseconds kOldestAsked{1000};                        // states before a request are seen by then
constexpr milliseconds kOldestSeen{500};                          // a page that moves arms sees newer states
constexpr milliseconds kIdle{100};                                // a turn without anybody who waits
constexpr auto kPollPeriod = std::chrono::microseconds(500);      // while an answer is pending
constexpr std::size_t kMostColumns = 64, kMostThinColumns = 512;  // numbers per row of a plot

const std::vector<std::string> kOwnRequests = {"subscribe", "unsubscribe", "plot", "control"};

HostTime after(HostTime now, nanoseconds duration) { return {now.ns + duration.count()}; }

json refusal(const std::string& code, const std::string& reason) {
  return {{"ok", false}, {"verdict", code}, {"reason", reason}};
}

void answer(Hub::Client& client, json message, const json& id) {
  message["id"] = id;
  client.send(message);
}

}  // namespace

void Desk::show(std::shared_ptr<Source> source, const std::string& reason) {
  const std::lock_guard lock(mutex_);
  if (source_) leave_source(reason);
  source_ = std::move(source);
  for (Seat& seat : seats_) {
    seat.plot = {};
    seat.events = seat.list = seat.shown = 0;
    if (source_) {
      greet(seat, nullptr);
    } else {
      seat.client->send({{"ended", {{"reason", reason}}}});
    }
  }
}

void Desk::on_owed_stop(std::function<void()> call) {
  const std::lock_guard lock(mutex_);
  owed_stop_ = std::move(call);
}

// The source will answer no more, and a Stop that is still in force must outlast it.
void Desk::leave_source(const std::string& reason) {
  if (hold_.begun()) end_hold("the run has ended", control_.holder());
  for (Seat& seat : seats_) {
    poll(seat);
    for (const Pending& request : std::exchange(seat.requests, {})) {
      const bool stop = request.word == "stop" && owed_stop_;
      finish(seat, request, {.answer = stop ? owe_stop() : refusal("run_ended", reason), .numbers = {}});
    }
  }
  if (stops_ != resumed_ && owed_stop_) owed_stop_();
  resumed_ = stops_;
}

json Desk::owe_stop() {
  owed_stop_();
  return {{"ok", true}, {"no_further_run", true}};
}

Desk::Seat& Desk::seat_of(const Hub::Client& client) {
  return *std::ranges::find(seats_, client.id(), [](const Seat& seat) { return seat.client->id(); });
}

void Desk::join(Hub::Client& client, const json& id) {
  const std::lock_guard lock(mutex_);
  Seat& seat = seats_.emplace_back();
  seat.client = &client;
  greet(seat, id);
  send_control();
}

void Desk::greet(Seat& seat, const json& id) {
  json hello = source_ ? source_->hello() : json{{"kind", "none"}};
  hello.update({{"wire", 1},
                {"client", seat.client->id()},
                {"beat_ms", 50},
                {"timeout_ms", 1e3 * DeadMan::kTimeout},
                {"control", control_of(seat)}});
  if (source_) seat.list = source_->list_version();
  json message = {{"hello", std::move(hello)}};
  if (id.is_null()) {
    seat.client->send(message);
  } else {
    message["ok"] = true;
    answer(*seat.client, std::move(message), id);
  }
}

void Desk::leave(Hub::Client& client) {
  const std::lock_guard lock(mutex_);
  const bool held = control_.held_by(client.id());
  control_.leave(client.id());
  std::erase_if(seats_, [&](const Seat& seat) { return seat.client == &client; });
  if (held && hold_.begun()) end_hold("the page of the one who commands is gone", client.id());
  send_control();
}

// --- messages ---

void Desk::take(Hub::Client& client, const json& message) {
  const std::lock_guard lock(mutex_);
  Seat& seat = seat_of(client);
  json id;
  try {
    const JsonFields fields(message, "request");
    if (take_signal(seat, message)) return;
    if (fields.has("id")) {
      if (message.at("id").is_structured()) fields.expected("id", "a number or a text");
      id = message.at("id");
    }
    take_request(seat, message, id);
  } catch (const RequestRefused& refused) {
    answer(client, refusal(refused.code, refused.what()), id);
  } catch (const json::exception& wrong) {
    answer(client, refusal("malformed", wrong.what()), id);
  } catch (const std::exception& wrong) {
    answer(client, refusal("failed", wrong.what()), id);
  }
}

// What is not answered: it comes often.
bool Desk::take_signal(Seat& seat, const json& message) {
  if (message.contains("do")) return false;
  if (message.contains("seen") && message.at("seen").is_number()) {
    const double seen = message.at("seen").get<double>();
    if (seen > seat.seen && seen <= seat.frame) {
      seat.seen = static_cast<std::uint32_t>(seen);
      seat.seen_sent = seat.sent[seat.seen % seat.sent.size()];
    }
    return true;
  }
  const bool mine = control_.held_by(seat.client->id());
  if (message.contains("beat")) {
    if (mine && sees_now(seat, host_now())) hold_.beat(host_now());
  } else if (message.contains("release")) {
    if (mine && hold_.begun()) {
      hold_.release();
      if (source_) source_->come_to_rest(false);
    }
  } else {
    return false;
  }
  if (hold_.begun() != held_before_) send_control();
  return true;
}

void Desk::take_request(Seat& seat, const json& message, const json& id) {
  const JsonFields fields(message, "request");
  const std::string word = fields.text("do");
  if (take_own_request(seat, message, id)) return;
  if (!source_ && word == "stop" && owed_stop_)
    return finish(seat, {.id = id, .word = word, .answer = {}}, {.answer = owe_stop(), .numbers = {}});
  if (!source_) fields.refuse("no run is shown at the moment");
  const auto commands = source_->commands();
  if (std::ranges::find(commands, word) == commands.end()) {
    auto all = commands;
    all.insert(all.end(), kOwnRequests.begin(), kOwnRequests.end());
    fields.refuse("unknown request '" + word.substr(0, 60) + "'" + name_hint(word, all, "there are none"));
  }
  if (!source_->is_open(word) && !control_.held_by(seat.client->id()))
    throw RequestRefused("no_control", control_.holder()
                                           ? "another page has the control: request it with 'control'"
                                           : "take the control first ('control')");
  if (!source_->is_open(word) && lags(seat, host_now()))
    throw RequestRefused("stale",
                         "the page has not confirmed a state for 1 s, so this may be a request of "
                         "before: ask again once it shows new states");
  if (source_->moves(word) && !hold_.held(host_now()))
    throw RequestRefused("not_held",
                         "arms move only while a button is held: send beats, and 'seen' for every state, at "
                         "least every 200 ms");
  if (seat.requests.size() >= kMostPending && word != "stop")
    throw RequestRefused("queue_full", "64 requests are not answered yet");
  auto result = source_->ask(message);
  if (word == "stop") ++stops_;
  Pending request{.id = id, .word = word, .stops = stops_, .answer = {}};
  if (auto* later = std::get_if<Later>(&result)) {
    request.answer = std::move(*later);
    seat.requests.push_back(std::move(request));
  } else {
    finish(seat, request, std::move(std::get<Reply>(result)));
  }
}

// Requests without an id, such as samples of a stream, are answered only if refused.
void Desk::finish(Seat& seat, const Pending& request, Reply reply) {
  const bool ok = reply.answer.value("ok", false);
  if (ok && request.word == "resume" && !source_->is_stopped()) resumed_ = request.stops;
  if (ok && request.id.is_null()) return;
  answer(*seat.client, std::move(reply.answer), request.id);
  if (!reply.numbers.empty()) seat.client->send_numbers(reply.numbers);
}

bool Desk::take_own_request(Seat& seat, const json& message, const json& id) {
  const std::string word = message.at("do").get<std::string>();
  if (word == "control") {
    take_control(seat, message, id);
  } else if (word == "subscribe") {
    subscribe(seat, message, id);
  } else if (word == "unsubscribe") {
    JsonFields(message, word).allow({"id", "do"});
    seat.period = {};
    answer(*seat.client, {{"ok", true}}, id);
  } else if (word == "plot") {
    take_plot(seat, message, id);
  } else {
    return false;
  }
  return true;
}

void Desk::subscribe(Seat& seat, const json& message, const json& id) {
  const JsonFields fields(message, "subscribe");
  fields.allow({"id", "do", "rate_hz"});
  const double rate = fields.number("rate_hz", kUsual);
  if (!(rate >= kSlowest && rate <= kFastest)) fields.expected("rate_hz", "0.1 to 120");
  seat.period = nanoseconds(static_cast<std::int64_t>(1e9 / rate));
  seat.next_state = host_now();
  seat.shown = 0;
  answer(*seat.client, {{"ok", true}, {"rate_hz", rate}}, id);
}

void Desk::take_plot(Seat& seat, const json& message, const json& id) {
  const JsonFields fields(message, "plot");
  fields.allow({"id", "do", "fields", "every"});
  if (!source_) fields.refuse("no run is shown at the moment");
  const double every = fields.number("every", 1);
  if (!(every >= 1 && every <= 1000) || every != static_cast<double>(static_cast<int>(every)))
    fields.expected("every", "a whole number of cycles, 1 to 1000");
  Plot plot = source_->open_plot(fields.texts("fields"), static_cast<std::uint64_t>(every));
  const json columns = source_->columns(plot);
  std::size_t width = 0;
  for (const auto& column : columns) width += column.at(1).get<std::size_t>();
  const std::size_t most = std::min<std::size_t>(kMostThinColumns, kMostColumns * plot.every);
  if (width > most)
    fields.refuse(std::to_string(width) + " numbers per row; at most " + std::to_string(most) + " of every " +
                  std::to_string(plot.every) + " cycles: choose fewer fields or a larger 'every'");
  seat.plot = std::move(plot);
  ++seat.plot_number;
  seat.next_plot = host_now();
  answer(*seat.client, {{"ok", true}, {"plot", seat.plot_number}, {"columns", columns}}, id);
}

// --- control ---

void Desk::take_control(Seat& seat, const json& message, const json& id) {
  const JsonFields fields(message, "control");
  fields.allow({"id", "do", "take", "give", "keep"});
  const ClientId client = seat.client->id();
  const auto before = control_.holder();
  json done = {{"ok", true}};
  if (fields.boolean("take", false)) {
    done["control"] = control_.take(client, host_now()) ? "taken" : "requested";
  } else if (!control_.held_by(client)) {
    throw RequestRefused("no_control", "only the page that has the control can hand it over");
  } else if (fields.boolean("keep", false)) {
    control_.keep();
  } else if (fields.has("give") && message.at("give").is_null()) {
    control_.give_up();
  } else if (!fields.has("give") || !message.at("give").is_number_integer()) {
    fields.refuse("expected 'take': true, 'keep': true, or 'give': the number of a page or null");
  } else if (!control_.give(message.at("give").get<ClientId>())) {
    fields.refuse("this page has not requested the control");
  }
  if (control_.holder() != before && hold_.begun()) end_hold("the control was handed over", before);
  answer(*seat.client, std::move(done), id);
  send_control();
}

json Desk::control_of(const Seat& seat) const {
  json requests = json::array();
  for (const auto& request : control_.requests()) requests.push_back(request.client);
  const std::size_t others = control_.holder() ? 1 : 0;
  return {{"holder", control_.holder() ? json(*control_.holder()) : json()},
          {"mine", control_.held_by(seat.client->id())},
          {"requests", requests},
          {"watchers", seats_.size() - std::min(others, seats_.size())},
          {"held", hold_.begun()}};
}

void Desk::send_control() {
  held_before_ = hold_.begun();
  for (Seat& seat : seats_) seat.client->send({{"control", control_of(seat)}});
}

// Whether the beats of this page are about now. A connection that stood still delivers all at once what was
// said meanwhile, presses that have long been let go included; but the page cannot have said it after a state
// that it had not seen. So beats count from pages that have seen a new state, sent after the hold that the
// run has ended.
bool Desk::sees_now(const Seat& seat, HostTime now) const {
  if (seat.period.count() == 0) return true;  // it takes no states
  return seat.seen_sent > hold_ended_ && now - seat.seen_sent <= kOldestSeen + seat.period;
}

// A connection that stood still delivers requests late, too: a gripper would close on the hand of whoever
// thought that it did not work. States that were sent long ago and are not seen yet tell so; a client that
// takes no states has no such protection.
bool Desk::lags(const Seat& seat, HostTime now) {
  if (seat.period.count() == 0 || seat.frame == seat.seen) return false;
  return now - seat.sent[(seat.seen + 1) % seat.sent.size()] > kOldestAsked + seat.period;
}

// The hold ended otherwise than by letting go: the arms go to hold.
void Desk::end_hold(const std::string& cause, std::optional<ClientId> holder) {
  hold_.release();
  hold_ended_ = host_now();
  if (source_) source_->come_to_rest(true);
  for (Seat& seat : seats_) {
    if (holder == seat.client->id()) seat.client->send({{"released", {{"cause", cause}}}});
  }
}

// --- what goes out ---

nanoseconds Desk::turn(HostTime now) {
  const std::lock_guard lock(mutex_);
  if (!source_) return kIdle;
  if (hold_.silent(now)) {
    end_hold("no beat came for 200 ms, or the page saw no new state", control_.holder());
    send_control();
  }
  const auto before = control_.holder();
  if (control_.pass_on(now, hold_.held(now))) {
    if (control_.holder() != before && hold_.begun()) end_hold("the control was handed over", before);
    send_control();
  }
  source_->update(now);
  for (Seat& seat : seats_) {
    poll(seat);
    send_state(seat, now);
    send_news(seat, now);
    send_plot(seat, now);
  }
  return until_next(now);
}

void Desk::poll(Seat& seat) {
  for (auto request = seat.requests.begin(); request != seat.requests.end();) {
    auto done = request->answer();
    if (!done) {
      ++request;
      continue;
    }
    finish(seat, *request, std::move(*done));
    request = seat.requests.erase(request);
  }
}

void Desk::send_state(Seat& seat, HostTime now) {
  if (seat.period.count() == 0 || now.ns < seat.next_state.ns) return;
  // Nothing is queued: the newest state waits until the client has taken the ones before it.
  if (seat.client->unsent() > 0 || seat.frame - seat.seen >= kMostAhead) return;
  const std::uint64_t newest = source_->newest();
  const bool stands_still = newest == seat.shown;
  if (newest == 0 || (stands_still && now - seat.last_state < kSlowPeriod)) return;
  seat.shown = newest;
  seat.last_state = now;
  // Late by more than a period: the next one is due a period from now.
  seat.next_state = after(seat.next_state, seat.period);
  if (seat.next_state.ns <= now.ns) seat.next_state = after(now, seat.period);
  const auto values = source_->state(now);
  seat.sent[++seat.frame % seat.sent.size()] = now;
  seat.client->send_numbers(state_frame(seat.frame, values));
}

void Desk::send_news(Seat& seat, HostTime now) {
  const std::uint64_t known = seat.events;
  if (auto events = source_->events(seat.events); !events.empty())
    seat.client->send({{"events", std::move(events)}});
  if (seat.events != known || now.ns >= seat.next_slow.ns) {
    if (json state = source_->slow_state(); !state.is_null())
      seat.client->send({{"state", std::move(state)}});
    seat.next_slow = after(now, kSlowPeriod);
  }
  if (seat.list != source_->list_version() && now.ns >= seat.next_list.ns) {
    seat.list = source_->list_version();
    seat.next_list = after(now, kListPeriod);
    seat.client->send({{"list", source_->list()}});
  }
}

void Desk::send_plot(Seat& seat, HostTime now) {
  if (seat.plot.fields.empty() || now.ns < seat.next_plot.ns || seat.client->unsent() > kMostUnsent) return;
  seat.next_plot = after(now, kPlotPeriod);
  std::string rows;
  const std::uint32_t count = source_->rows(seat.plot, rows);
  if (count == 0) return;
  const auto columns = static_cast<std::uint32_t>(rows.size() / sizeof(double) / count);
  seat.client->send_numbers(rows_frame(kPlotRows, seat.plot_number, count, columns, rows));
}

nanoseconds Desk::until_next(HostTime now) const {
  nanoseconds next = kIdle;
  for (const Seat& seat : seats_) {
    if (!seat.requests.empty()) next = std::min<nanoseconds>(next, kPollPeriod);
    if (seat.period.count() > 0 && seat.client->unsent() == 0 && seat.frame - seat.seen < kMostAhead)
      next = std::min<nanoseconds>(next, std::max<nanoseconds>(seat.next_state - now, kPollPeriod));
    if (!seat.plot.fields.empty()) next = std::min<nanoseconds>(next, kPlotPeriod);
    next = std::min<nanoseconds>(next, milliseconds(20));  // events
  }
  if (hold_.begun()) next = std::min<nanoseconds>(next, milliseconds(5));
  return next;
}

}  // namespace multipanda::cockpit

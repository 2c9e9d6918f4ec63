#include "cockpit/clients/clients.hpp"

#include <algorithm>
#include <cstring>
#include <utility>

#include "cockpit/clients/source.hpp"
#include "common/text.hpp"
#include "runtime/live_input/json_fields.hpp"

namespace multipanda::cockpit {
namespace {

using nlohmann::json;
using std::chrono::milliseconds;
using std::chrono::nanoseconds;

constexpr double kSlowest = 0.1, kFastest = 120, kUsual = 60;  // states [Hz]
constexpr milliseconds kSlowPeriod{200}, kListPeriod{200}, kPlotPeriod{20};
constexpr milliseconds kOldestAsked{1000};                        // states from before a request must be
                                                                  // confirmed within this time
constexpr milliseconds kOldestSeen{500};                          // a page that moves arms must confirm newer
                                                                  // states
constexpr milliseconds kIdle{100};                                // duration of a turn without waiting
                                                                  // clients
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

void Clients::show(std::shared_ptr<Source> source, const std::string& reason) {
  const std::lock_guard lock(mutex_);
  if (source_) leave_source(reason);
  source_ = std::move(source);
  for (Page& page : pages_) {
    page.plot = {};
    page.events = page.list = page.shown = 0;
    if (source_) {
      send_hello(page, nullptr);
    } else {
      page.client->send({{"ended", {{"reason", reason}}}});
    }
  }
}

void Clients::on_stop_between_runs(std::function<void()> call) {
  const std::lock_guard lock(mutex_);
  stop_between_runs_ = std::move(call);
}

// The source no longer answers; an active Stop must outlast it.
void Clients::leave_source(const std::string& reason) {
  if (hold_.begun()) end_hold("the run has ended", control_.holder());
  for (Page& page : pages_) {
    poll(page);
    for (const Pending& request : std::exchange(page.requests, {})) {
      const bool stop = request.word == "stop" && stop_between_runs_;
      finish(page, request,
             {.answer = stop ? stop_between_runs() : refusal("run_ended", reason), .numbers = {}});
    }
  }
  if (stops_ != resumed_ && stop_between_runs_) stop_between_runs_();
  resumed_ = stops_;
}

json Clients::stop_between_runs() {
  stop_between_runs_();
  return {{"ok", true}, {"no_further_run", true}};
}

Clients::Page& Clients::page_of(const Hub::Client& client) {
  return *std::ranges::find(pages_, client.id(), [](const Page& page) { return page.client->id(); });
}

void Clients::join(Hub::Client& client, const json& id) {
  const std::lock_guard lock(mutex_);
  Page& page = pages_.emplace_back();
  page.client = &client;
  send_hello(page, id);
  send_control();
}

void Clients::send_hello(Page& page, const json& id) {
  json hello = source_ ? source_->hello() : json{{"kind", "none"}};
  hello.update({{"wire", 1},
                {"client", page.client->id()},
                {"beat_ms", 50},
                {"timeout_ms", 1e3 * DeadMan::kTimeout},
                {"control", control_of(page)}});
  if (source_) page.list = source_->list_version();
  json message = {{"hello", std::move(hello)}};
  if (id.is_null()) {
    page.client->send(message);
  } else {
    message["ok"] = true;
    answer(*page.client, std::move(message), id);
  }
}

void Clients::leave(Hub::Client& client) {
  const std::lock_guard lock(mutex_);
  if (control_.held_by(client.id()) && hold_.begun())
    end_hold("the page in control has disconnected", client.id());
  control_.leave(client.id());
  std::erase_if(pages_, [&](const Page& page) { return page.client == &client; });
  send_control();
}

// --- messages ---

bool Clients::is_urgent(const std::string& message) const {
  return message.find("stop") != std::string::npos && is_stop(json::parse(message, nullptr, false));
}

// A switch to hold, which needs no hand on a button.
bool Clients::outlasts(const std::string& message) {
  const std::lock_guard lock(mutex_);
  const json request = json::parse(message, nullptr, false);
  if (!source_ || !request.is_object() || request.value("do", json()) != "switch") return false;
  try {
    return !source_->moves(request);
  } catch (const RequestRefused&) {
    return false;
  }
}

void Clients::take(Hub::Client& client, const json& message, HostTime arrived) {
  const std::lock_guard lock(mutex_);
  Page& page = page_of(client);
  (void)gaps_.look();
  json id;
  try {
    const JsonFields fields(message, "request");
    const bool late = arrived.ns == 0 || gaps_.settles(arrived);
    if (take_signal(page, message, late)) return;
    if (fields.has("id")) {
      if (!message.at("id").is_structured())
        id = message.at("id");
      else if (!is_stop(message))
        fields.expected("id", "a number or a text");
    }
    // Queries move nothing, and a page sends them only once.
    const std::string word = message.value("do", "");
    const bool looks = word == "subscribe" || word == "unsubscribe" || word == "plot";
    if (!looks && !is_stop(message) && late) throw RequestRefused("timeout", kStalled);
    take_request(page, message, id, arrived);
  } catch (const RequestRefused& refused) {
    answer(client, refusal(refused.code, refused.what()), id);
  } catch (const json::exception& wrong) {
    answer(client, refusal("malformed", wrong.what()), id);
  } catch (const std::exception& wrong) {
    answer(client, refusal("failed", wrong.what()), id);
  }
}

// Frequent messages that are not answered.
bool Clients::take_signal(Page& page, const json& message, bool late) {
  if (message.contains("do")) return false;
  if (message.contains("seen") && message.at("seen").is_number()) {
    const double seen = message.at("seen").get<double>();
    if (seen > page.seen && seen <= page.frame) {
      page.seen = static_cast<std::uint32_t>(seen);
      page.seen_sent = page.sent[page.seen % page.sent.size()];
    }
    return true;
  }
  const bool mine = control_.held_by(page.client->id());
  if (message.contains("beat")) {
    if (mine && sees_now(page, host_now()) && !late && !gaps_.settles()) hold_.beat(host_now());
  } else if (message.contains("release")) {
    if (mine && hold_.begun()) {
      hold_.release();
      const std::string cause = source_ ? source_->come_to_rest(false) : std::string();
      if (!cause.empty()) page.client->send({{"released", {{"cause", cause}}}});
    }
  } else {
    return false;
  }
  if (hold_.begun() != held_before_) send_control();
  return true;
}

void Clients::take_request(Page& page, const json& message, const json& id, HostTime arrived) {
  const JsonFields fields(message, "request");
  const std::string word = fields.text("do");
  if (take_own_request(page, message, id)) return;
  if (!source_ && word == "stop" && stop_between_runs_)
    return finish(page, {.id = id, .word = word, .answer = {}},
                  {.answer = stop_between_runs(), .numbers = {}});
  if (!source_) fields.refuse("no run is shown at the moment");
  const auto commands = source_->commands();
  if (std::ranges::find(commands, word) == commands.end()) {
    auto all = commands;
    all.insert(all.end(), kOwnRequests.begin(), kOwnRequests.end());
    fields.refuse("unknown request '" + word.substr(0, 60) + "'" + name_hint(word, all, "there are none"));
  }
  if (!source_->is_open(word) && !control_.held_by(page.client->id()))
    throw RequestRefused("no_control", control_.holder()
                                           ? "another page has control: request it with 'control'"
                                           : "take control first ('control')");
  if (!source_->is_open(word) && lags(page, host_now()))
    throw RequestRefused("stale",
                         "the page has not confirmed a state for 1 s, so this request may be outdated: "
                         "repeat it once the page shows new states");
  if (!source_->is_open(word) && source_->moves(message) && !hold_.held(host_now()))
    throw RequestRefused("not_held",
                         "arms move only while a button is held: send 'beat', and 'seen' for every state, at "
                         "least every 200 ms");
  if (page.requests.size() >= kMostPending && word != "stop")
    throw RequestRefused("queue_full", "64 requests are not answered yet");
  auto result = source_->ask(message, arrived);
  if (word == "stop") ++stops_;
  Pending request{.id = id, .word = word, .stops = stops_, .answer = {}};
  if (auto* later = std::get_if<Later>(&result)) {
    request.answer = std::move(*later);
    page.requests.push_back(std::move(request));
  } else {
    finish(page, request, std::move(std::get<Reply>(result)));
  }
}

// Requests without an id, such as samples of a stream, are answered only if there is something to say.
void Clients::finish(Page& page, const Pending& request, Reply reply) {
  const bool ok = reply.answer.value("ok", false);
  if (ok && request.word == "resume" && !source_->is_stopped()) resumed_ = request.stops;
  if (ok && request.id.is_null() && !reply.answer.contains("message")) return;
  answer(*page.client, std::move(reply.answer), request.id);
  if (!reply.numbers.empty()) page.client->send_numbers(reply.numbers);
}

bool Clients::take_own_request(Page& page, const json& message, const json& id) {
  const std::string word = message.at("do").get<std::string>();
  if (word == "control") {
    take_control(page, message, id);
  } else if (word == "subscribe") {
    subscribe(page, message, id);
  } else if (word == "unsubscribe") {
    JsonFields(message, word).allow({"id", "do"});
    page.period = {};
    answer(*page.client, {{"ok", true}}, id);
  } else if (word == "plot") {
    take_plot(page, message, id);
  } else {
    return false;
  }
  return true;
}

void Clients::subscribe(Page& page, const json& message, const json& id) {
  const JsonFields fields(message, "subscribe");
  fields.allow({"id", "do", "rate_hz"});
  const double rate = fields.number("rate_hz", kUsual);
  if (!(rate >= kSlowest && rate <= kFastest)) fields.expected("rate_hz", "0.1 to 120");
  page.period = nanoseconds(static_cast<std::int64_t>(1e9 / rate));
  page.subscribed = page.next_state = host_now();
  page.shown = 0;
  answer(*page.client, {{"ok", true}, {"rate_hz", rate}}, id);
}

void Clients::take_plot(Page& page, const json& message, const json& id) {
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
  page.plot = std::move(plot);
  ++page.plot_number;
  page.next_plot = host_now();
  answer(*page.client, {{"ok", true}, {"plot", page.plot_number}, {"columns", columns}}, id);
}

// --- control ---

void Clients::take_control(Page& page, const json& message, const json& id) {
  const JsonFields fields(message, "control");
  fields.allow({"id", "do", "take", "give", "keep"});
  const ClientId client = page.client->id();
  const auto before = control_.holder();
  json done = {{"ok", true}};
  if (fields.boolean("take", false)) {
    done["control"] = control_.take(client, host_now()) ? "taken" : "requested";
  } else if (!control_.held_by(client)) {
    throw RequestRefused("no_control", "only the page in control can hand it over");
  } else if (fields.boolean("keep", false)) {
    control_.keep();
  } else if (fields.has("give") && message.at("give").is_null()) {
    control_.give_up();
  } else if (!fields.has("give") || !message.at("give").is_number_integer()) {
    fields.refuse("expected 'take': true, 'keep': true, or 'give': the number of a page or null");
  } else if (!control_.give(message.at("give").get<ClientId>())) {
    fields.refuse("this page has not requested control");
  }
  if (control_.holder() != before && hold_.begun()) end_hold("control was handed over", before);
  answer(*page.client, std::move(done), id);
  send_control();
}

json Clients::control_of(const Page& page) const {
  json requests = json::array();
  for (const auto& request : control_.requests()) requests.push_back(request.client);
  const std::size_t others = control_.holder() ? 1 : 0;
  return {{"holder", control_.holder() ? json(*control_.holder()) : json()},
          {"mine", control_.held_by(page.client->id())},
          {"requests", requests},
          {"watchers", pages_.size() - std::min(others, pages_.size())},
          {"held", hold_.begun()}};
}

void Clients::send_control() {
  held_before_ = hold_.begun();
  for (Page& page : pages_) page.client->send({{"control", control_of(page)}});
}

// Whether the beats of this page are current. A connection that stalled delivers old messages all at once,
// including beats of buttons that were released long ago. But these are older than any state that the page
// has not yet confirmed. So beats count only from a page that has confirmed a state sent after the end of the
// last hold.
bool Clients::sees_now(const Page& page, HostTime now) const {
  if (page.period.count() == 0) return true;  // takes no states
  return page.seen_sent > hold_ended_ && now - page.seen_sent <= kOldestSeen + page.period;
}

// A connection that stalled delivers requests late, too: a gripper could close on a hand that reaches in. A
// page sends a request after the last state that it confirmed, so the age of that state bounds the age of the
// request. A client that receives no states has no such protection, nor has a run before its first cycle,
// whose arms may have to be recovered or reconnected.
bool Clients::lags(const Page& page, HostTime now) const {
  if (page.period.count() == 0 || (page.shown == 0 && source_->newest() == 0)) return false;
  return now - std::max(page.subscribed, page.seen_sent) > kOldestAsked + page.period;
}

// The hold did not end by a release: the arms go to hold.
void Clients::end_hold(const std::string& cause, std::optional<ClientId> holder) {
  hold_.release();
  hold_ended_ = host_now();
  if (source_) (void)source_->come_to_rest(true);
  for (Page& page : pages_) {
    if (holder == page.client->id()) page.client->send({{"released", {{"cause", cause}}}});
  }
}

// --- output ---

nanoseconds Clients::turn(HostTime now) {
  const std::lock_guard lock(mutex_);
  (void)gaps_.look();
  if (!source_) return kIdle;
  if (hold_.silent(now)) {
    end_hold("no 'beat' arrived for 200 ms, or the page saw no new state", control_.holder());
    send_control();
  }
  const auto before = control_.holder();
  if (control_.pass_on(now, hold_.held(now))) {
    if (control_.holder() != before && hold_.begun()) end_hold("control was handed over", before);
    send_control();
  }
  source_->update(now);
  for (Page& page : pages_) {
    poll(page);
    send_state(page, now);
    send_news(page, now);
    send_plot(page, now);
  }
  return until_next(now);
}

void Clients::poll(Page& page) {
  for (auto request = page.requests.begin(); request != page.requests.end();) {
    auto done = request->answer();
    if (!done) {
      ++request;
      continue;
    }
    finish(page, *request, std::move(*done));
    request = page.requests.erase(request);
  }
}

void Clients::send_state(Page& page, HostTime now) {
  if (page.period.count() == 0 || now.ns < page.next_state.ns) return;
  // Nothing is queued: the newest state waits until the client has taken earlier ones.
  if (page.client->unsent() > 0 || page.frame - page.seen >= kMostAhead) return;
  const std::uint64_t newest = source_->newest();
  const bool stands_still = newest == page.shown;
  if (newest == 0 || (stands_still && now - page.last_state < kSlowPeriod)) return;
  page.shown = newest;
  page.last_state = now;
  // Late by more than a period: the next one is due a period from now.
  page.next_state = after(page.next_state, page.period);
  if (page.next_state.ns <= now.ns) page.next_state = after(now, page.period);
  const auto values = source_->state(now);
  page.sent[++page.frame % page.sent.size()] = now;
  page.client->send_numbers(state_frame(page.frame, values));
}

void Clients::send_news(Page& page, HostTime now) {
  const std::uint64_t known = page.events;
  if (auto events = source_->events(page.events); !events.empty())
    page.client->send({{"events", std::move(events)}});
  if (page.events != known || now.ns >= page.next_slow.ns) {
    if (json state = source_->slow_state(); !state.is_null())
      page.client->send({{"state", std::move(state)}});
    page.next_slow = after(now, kSlowPeriod);
  }
  if (page.list != source_->list_version() && now.ns >= page.next_list.ns) {
    page.list = source_->list_version();
    page.next_list = after(now, kListPeriod);
    page.client->send({{"list", source_->list()}});
  }
}

void Clients::send_plot(Page& page, HostTime now) {
  if (page.plot.fields.empty() || now.ns < page.next_plot.ns || page.client->unsent() > kMostUnsent) return;
  page.next_plot = after(now, kPlotPeriod);
  std::string rows;
  const std::uint32_t count = source_->rows(page.plot, rows);
  if (count == 0) return;
  const auto columns = static_cast<std::uint32_t>(rows.size() / sizeof(double) / count);
  page.client->send_numbers(rows_frame(kPlotRows, page.plot_number, count, columns, rows));
}

nanoseconds Clients::until_next(HostTime now) const {
  nanoseconds next = kIdle;
  for (const Page& page : pages_) {
    if (!page.requests.empty()) next = std::min<nanoseconds>(next, kPollPeriod);
    if (page.period.count() > 0 && page.client->unsent() == 0 && page.frame - page.seen < kMostAhead)
      next = std::min<nanoseconds>(next, std::max<nanoseconds>(page.next_state - now, kPollPeriod));
    if (!page.plot.fields.empty()) next = std::min<nanoseconds>(next, kPlotPeriod);
    next = std::min<nanoseconds>(next, milliseconds(20));  // events
  }
  if (hold_.begun()) next = std::min<nanoseconds>(next, milliseconds(5));
  return next;
}

}  // namespace multipanda::cockpit

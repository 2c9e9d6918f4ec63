#include "runtime/live_input/server.hpp"

#include <algorithm>
#include <cctype>
#include <cmath>
#include <limits>
#include <poll.h>
#include <string_view>
#include <sys/eventfd.h>
#include <sys/resource.h>
#include <sys/socket.h>
#include <tuple>
#include <unistd.h>
#include <utility>
#include <vector>

#include "common/text.hpp"

namespace multipanda {
namespace {

using nlohmann::json;

constexpr auto kPollPeriod = std::chrono::microseconds(500);  // while an answer of the loop is pending
constexpr auto kTurn = std::chrono::milliseconds(2);          // for requests, and for packets; a stop waits
constexpr double kSlowest = 0.1, kFastest = 1000;             // of a subscription [Hz]
constexpr std::size_t kMostLast = 16,
                      kLongestLast = 1024;  // lines of a client that count out of turn; bytes of one
constexpr double kLeastSilence = 0.2, kMostSilence = 60;  // of a client that leads [s]

json refusal(const std::string& code, const std::string& reason) {
  return {{"ok", false}, {"verdict", code}, {"reason", reason}};
}

// In lower-case text.
bool has_word(std::string_view text, std::string_view word) {
  const auto is_part = [&](std::size_t i) {
    return i < text.size() && ((text[i] >= 'a' && text[i] <= 'z') || text[i] == '_');
  };
  for (std::size_t at = text.find(word); at != text.npos; at = text.find(word, at + 1)) {
    if (!is_part(at - 1) && !is_part(at + word.size())) return true;
  }
  return false;
}

}  // namespace

LiveServer::Publisher::~Publisher() { close(file); }

LiveServer::LiveServer(const std::filesystem::path& path, LiveInputContext run, double (*realtime)())
    : claim_(std::filesystem::absolute(path)), handler_(std::move(run)), realtime_(realtime) {
  try {
    packets_ = listen_at(stream_path(claim_.path()), SOCK_SEQPACKET);
    lines_ = listen_at(claim_.path(), SOCK_STREAM);
    wake_ = eventfd(0, EFD_CLOEXEC | EFD_NONBLOCK);
    if (wake_ < 0) throw std::runtime_error("cannot open an eventfd");
    (void)gaps_.look();
    thread_ = std::thread([this] { this->run(); });
  } catch (...) {
    for (const int file : {lines_, packets_, wake_}) {
      if (file >= 0) close(file);
    }
    throw;
  }
}

LiveServer::~LiveServer() {
  ending_.store(true, std::memory_order_release);
  const std::uint64_t one = 1;
  while (write(wake_, &one, sizeof(one)) < 0 && errno == EINTR) {
  }
  thread_.join();
  for (const int file : {lines_, packets_, wake_}) close(file);
}

void LiveServer::run() {
  // Where it is permitted, a stop does not wait for programs that use the whole processor.
  (void)setpriority(PRIO_PROCESS, static_cast<id_t>(gettid()), -15);
  while (!ending_.load(std::memory_order_acquire)) {
    wait();
    const auto now = Clock::now();
    handler_.end_following();
    std::string state;  // made once a turn, for all that are due
    for (Client& client : clients_) {
      poll_requests(client);
      send_state(client, now, state);
      client.line.flush();
      if (client.leaves.ns != 0 && host_now() > client.leaves) send_away(client);
      const bool silent = client.leads != 0 && host_now() - client.heard > client.silence;
      const bool done = client.line.input_ended() && client.requests.empty() && client.waiting.empty() &&
                        client.period.count() == 0 && client.line.unsent() == 0;
      client.gone = client.gone || client.line.broken() || done || silent;
      if (!client.gone) continue;
      hang_up(client);
      client.line.flush();
    }
    for (auto& [number, channel] : channels_) {
      const bool closed = channel.sender != nullptr && channel.sender->gone;
      if (channel.owner->gone || closed) handler_.discard(channel.stream);
      if (closed) channel.sender = nullptr;
    }
    std::erase_if(channels_, [](const auto& entry) { return entry.second.owner->gone; });
    std::erase_if(clients_, [](const Client& client) { return client.gone; });
    record_readers_.store(static_cast<std::size_t>(std::ranges::count_if(clients_, &Client::has_records)),
                          std::memory_order_relaxed);
    std::erase_if(publishers_, [](const Publisher& publisher) { return publisher.gone; });
  }
  for (Client& client : clients_) {
    poll_requests(client);
    client.line.flush();
  }
}

// Waits until something arrives or is due, and handles it.
void LiveServer::wait() {
  std::vector<pollfd> files{{wake_, POLLIN, 0}, {lines_, POLLIN, 0}};
  constexpr std::size_t kFixed = 2;
  std::chrono::nanoseconds timeout = GapWatch::kSlice;
  const auto now = Clock::now();
  for (const Client& client : clients_) {
    int events = client.line.input_ended() ? 0 : POLLIN;
    if (client.line.unsent() > 0) events |= POLLOUT;
    files.push_back({client.line.file(), static_cast<short>(events), 0});
    if (!client.waiting.empty() && may_take(client) && client.stays()) timeout = std::chrono::nanoseconds(0);
    if (!client.requests.empty()) timeout = std::min<std::chrono::nanoseconds>(timeout, kPollPeriod);
    if (client.period.count() > 0) {
      timeout =
          std::clamp<std::chrono::nanoseconds>(client.next_state - now, std::chrono::nanoseconds(0), timeout);
    }
  }
  for (const Publisher& publisher : publishers_) files.push_back({publisher.file, POLLIN, 0});
  files.push_back({packets_, POLLIN, 0});
  const timespec spec{.tv_sec = timeout.count() / 1'000'000'000, .tv_nsec = timeout.count() % 1'000'000'000};
  const std::size_t client_count = clients_.size(), known = publishers_.size();
  if (ppoll(files.data(), files.size(), &spec, nullptr) < 0) return;  // a signal
  (void)gaps_.look();
  // Stops first.
  std::size_t k = kFixed;
  for (Client& client : clients_) {
    const short events = files[k++].revents;
    // Both directions are closed: no client waits for an answer.
    const bool closed = (events & (POLLHUP | POLLERR)) != 0;
    if ((events & POLLIN) != 0 || closed) read(client);
    client.gone = client.gone || closed;
  }
  if (files[1].revents != 0) accept_clients();
  // Packets are handled before other requests, so their order with requests is kept.
  if (files.back().revents != 0) accept_publishers();
  k = kFixed + client_count;
  const auto until = Clock::now() + kTurn;
  for (Publisher& publisher : publishers_) {
    const bool is_new = k >= kFixed + client_count + known;
    if ((is_new || files[k].revents != 0) && Clock::now() < until) take_packets(publisher);
    ++k;
  }
  if (!publishers_.empty()) publishers_.splice(publishers_.end(), publishers_, publishers_.begin());
  take_lines();
}

bool LiveServer::may_take(const Client& client) const {
  return client.requests.size() < kMaxPending && client.line.unsent() < kMaxAhead;
}

// All that wait, as a stop may be behind them. A full server makes room, so that a client that leaks
// connections cannot prevent a stop.
void LiveServer::accept_clients() {
  for (const auto until = Clock::now() + kTurn; Clock::now() < until;) {
    const int file = accept4(lines_, nullptr, nullptr, SOCK_NONBLOCK | SOCK_CLOEXEC);
    if (file < 0 && (errno == EMFILE || errno == ENFILE)) make_room(0);
    if (file < 0) return;
    if (std::cmp_greater_equal(std::ranges::count_if(clients_, &Client::stays), kMaxClients)) make_room();
    read(clients_.emplace_back(file));  // its first request is usually here already
  }
}

// Ends the client that was silent for longest, one that only holds a connection if there is one. It may have
// just connected, before its first request: for a while, a stop from it still counts.
void LiveServer::make_room(std::ptrdiff_t most_leaving) {
  constexpr std::chrono::seconds kFarewell{1};
  const auto leaving = [](const Client& client) { return !client.gone && client.leaves.ns != 0; };
  if (std::ranges::count_if(clients_, leaving) >= most_leaving) {
    const auto first = std::ranges::min_element(
        clients_, {}, [&](const Client& client) { return std::pair(!leaving(client), client.leaves); });
    if (first != clients_.end() && leaving(*first)) send_away(*first);
  }
  const auto rank = [this](const Client& client) {
    const bool busy =
        client.period.count() > 0 || client.has_records || client.leads != 0 || !client.requests.empty() ||
        !client.waiting.empty() ||
        std::ranges::any_of(channels_, [&](const auto& entry) { return entry.second.owner == &client; });
    return std::tuple(!client.stays(), busy, client.heard);
  };
  const auto least = std::ranges::min_element(clients_, {}, rank);
  if (least == clients_.end() || !least->stays()) return;
  least->leaves = host_now() + kFarewell;
  if (most_leaving == 0) send_away(*least);
}

void LiveServer::send_away(Client& client) {
  client.gone = true;
  answer(client,
         refusal("too_many_clients",
                 "64 clients are connected, and this one, silent for longest, was closed for another: close "
                 "unused connections, then connect again"),
         nullptr);
}

void LiveServer::accept_publishers() {
  for (;;) {
    const int file = accept4(packets_, nullptr, nullptr, SOCK_NONBLOCK | SOCK_CLOEXEC);
    if (file < 0) return;
    note_sending_times(file);
    publishers_.emplace_back(file);
    if (publishers_.size() > kMaxClients) publishers_.pop_back();  // the client sees a closed socket
  }
}

// Takes the data that has arrived: stops at once, and `lead`, since what it names ends with a client that
// dies before its turn; other requests in turn. Returns whether something came.
bool LiveServer::read(Client& client) {
  const bool came = client.line.receive();
  std::size_t leads = 0;
  const HostTime now = host_now();
  // A request without a time may have waited in the socket since before a gap.
  const HostTime arrived = gaps_.settles() ? HostTime{} : now;
  while (auto line = client.line.next()) {
    client.heard = now;
    if (take_stop(client, line->text)) continue;
    if (leads < kMostLast && line->text.size() < kLongestLast &&
        line->text.find("\"lead\"") != line->text.npos) {
      ++leads;
      take_line(client, {std::move(*line), arrived});
      continue;
    }
    if (client.waiting_bytes > kMaxWaiting) {
      ++client.dropped;
      continue;
    }
    client.waiting.push_back({std::move(*line), arrived});
    client.waiting_bytes += client.waiting.back().bytes();
  }
  return came;
}

// Its last lines count if they are stops or switches to hold; kMostLast of these at most, since others' stops
// wait meanwhile. Its other requests do not begin.
void LiveServer::hang_up(Client& client) {
  constexpr int kMostTurns = 64;  // a socket buffer holds less
  for (int turn = 0; turn < kMostTurns && read(client); ++turn) {
  }
  std::vector<Waiting> last;  // newest first
  const auto waiting = std::exchange(client.waiting, {});
  for (auto line = waiting.rbegin(); line != waiting.rend() && last.size() < kMostLast; ++line) {
    const std::string& text = line->line.text;
    if (text.size() < kLongestLast && text.find("\"switch\"") != text.npos) last.push_back(*line);
  }
  for (auto line = last.rbegin(); line != last.rend(); ++line) {
    if (handler_.only_holds(json::parse(line->line.text, nullptr, false))) take_line(client, *line);
  }
  for (Started& started : client.requests) (void)handler_.abandon(started.pending);
  handler_.end_following(&client);
  if (client.leads != 0) end_or_stop(handler_.modes(), client.leads);
}

// A stop is executed even if it is invalid, and even if the client exceeds its number of requests. So is a
// line that contains "stop" but is not valid JSON (a NaN, a wrong byte, a lost end, other quotes) or not
// an object.
bool LiveServer::take_stop(Client& client, const std::string& text) {
  const auto lower = [](std::string_view of) {
    std::string word(trimmed(of));
    std::ranges::transform(word, word.begin(), [](unsigned char c) { return std::tolower(c); });
    return word;
  };
  const std::string line = lower(text);
  if (line.find("stop") == std::string::npos) return false;
  json request = line == "stop" ? json{{"do", "stop"}} : json::parse(text, nullptr, false);
  if (!request.is_object() && has_word(line, "stop"))
    request = {{"do", "stop"}, {"this line, which is not a JSON object", true}};
  if (request.is_object() && request.value("do", json()).is_string() &&
      lower(request["do"].get<std::string>()) == "stop")
    request["do"] = "stop";
  if (!is_stop(request)) return false;
  Started started{.id = request.value("id", json()), .pending = {}};
  if (started.id.is_structured()) started.id = nullptr;
  (void)handler_.begin(request, started.pending);
  constexpr std::size_t kMostAnswers = 2 * kMaxPending;
  if (client.requests.size() < kMostAnswers && client.line.unsent() < 2 * kMaxAhead)
    client.requests.push_back(std::move(started));
  return true;
}

// In turn, as many as there is time for.
void LiveServer::take_lines() {
  const auto until = Clock::now() + kTurn;
  (void)gaps_.look(host_now(), 0);  // the program may have stalled since the clients were read
  if (!clients_.empty()) clients_.splice(clients_.end(), clients_, clients_.begin());
  for (bool more = true; more;) {
    more = false;
    for (Client& client : clients_) {
      if (client.waiting.empty() || !may_take(client) || !client.stays()) continue;
      if (Clock::now() >= until) return;
      // It may have closed since it was read, or before it was accepted: its requests do not begin.
      if ((client.gone = client.line.hung_up())) continue;
      const Waiting next = std::move(client.waiting.front());
      client.waiting.pop_front();
      client.waiting_bytes -= next.bytes();
      take_line(client, next);
      more = true;
    }
  }
}

// `now_ns` tells clients of other computers the clock by which requests are too old.
void LiveServer::answer(Client& client, json answer, const json& id) {
  answer["id"] = id;
  answer["now_ns"] = host_now().ns;
  client.line.send(to_line(answer));
}

// The same refusal of samples, which come often, is reported once a second.
void LiveServer::refuse(Client& client, json why, const json& id) {
  if (id.is_null()) {
    const auto now = Clock::now();
    if (why == client.refused && now - client.refused_at < std::chrono::seconds(1)) {
      ++client.refused_again;
      return;
    }
    client.refused = why;
    client.refused_at = now;
    if (const auto again = std::exchange(client.refused_again, 0)) why["repeated"] = again;
  }
  answer(client, std::move(why), id);
}

void LiveServer::take_line(Client& client, const Waiting& waiting) {
  json id;
  const auto& [line, arrived] = waiting;
  if (const auto dropped = std::exchange(client.dropped, 0)) {
    answer(client,
           refusal("queue_full", std::to_string(dropped) + " requests were not executed: this client has too "
                                                           "many unanswered requests; read the answers"),
           nullptr);
  }
  if (line.too_long) return refuse(client, refusal("malformed", "a line has at most 65536 bytes"), id);
  if (line.text.find_first_not_of(" \t") == std::string::npos) return;
  try {
    const json request = json::parse(line.text);
    const JsonFields fields(request, "request");
    if (fields.has("id")) {
      const json& given = request.at("id");
      if (given.is_structured()) fields.expected("id", "a number or a text");
      id = given;
    }
    if (take_connection_request(client, request, id)) return;
    Started started{.id = id, .pending = {}};
    started.pending.client = &client;
    const HostTime not_before =
        gaps_.look(host_now(), 0);  // this thread may have stalled since it read the line
    if (auto at_once = handler_.begin(request, started.pending, arrived, not_before)) {
      // Samples of a stream without an id are answered only if refused.
      if (at_once->contains("streamed") && id.is_null()) return;
      if (at_once->value("ok", false)) return answer(client, std::move(*at_once), id);
      refuse(client, std::move(*at_once), id);
    } else {
      client.requests.push_back(std::move(started));
    }
  } catch (const RequestRefused& refused) {
    refuse(client, refusal(refused.code, refused.what()), id);
  } catch (const json::exception& wrong) {
    refuse(client, refusal("malformed", std::string("not JSON: ") + wrong.what()), id);
  } catch (const std::exception& wrong) {
    refuse(client, refusal("failed", wrong.what()), id);
  }
}

// Handles requests that concern the connection. Returns false for all others.
bool LiveServer::take_connection_request(Client& client, const json& request, const json& id) {
  const JsonFields fields(request, "request");
  const std::string word = fields.text("do");
  const JsonFields named(request, word);
  if (word == "subscribe") {
    named.allow(with_common({"rate_hz"}));
    const double rate = named.number("rate_hz", 10);
    if (!(rate >= kSlowest && rate <= kFastest)) named.expected("rate_hz", "0.1 to 1000");
    client.period = std::chrono::nanoseconds(static_cast<std::int64_t>(1e9 / rate));
    client.next_state = Clock::now();
    client.subscription = id;
    answer(client, {{"ok", true}, {"rate_hz", rate}}, id);
  } else if (word == "unsubscribe") {
    named.allow(with_common({}));
    client.period = {};
    answer(client, {{"ok", true}}, id);
  } else if (word == "lead") {
    take_lead(client, named, id);
  } else if (word == "records") {
    named.allow(with_common({}));
    pass_records(client, named, id);
  } else if (word == "stream") {
    Channel channel{.owner = &client, .stream = handler_.open_channel(request)};
    if (channels_.size() >= kMaxChannels) named.refuse("256 channels are open: end one first (stream_end)");
    const std::uint32_t number = next_channel_++;
    channels_.emplace(number, std::move(channel));
    answer(client,
           {{"ok", true},
            {"channel", number},
            {"path", stream_path(path()).string()},
            {"longest_chunk", Chunk::kMostSamples}},
           id);
  } else if (word == "stream_end") {
    named.allow(with_common({"channel"}));
    const double number = named.number("channel");
    const auto found = std::find_if(channels_.begin(), channels_.end(), [&](const auto& entry) {
      return entry.second.owner == &client && std::abs(entry.first - number) < 0.5;
    });
    if (found == channels_.end()) named.refuse("this connection has no such channel");
    answer(client, {{"ok", true}, {"channel", handler_.describe(found->second.stream)}}, id);
    handler_.discard(found->second.stream);
    channels_.erase(found);
  } else if (word == "channels") {
    named.allow(with_common({}));
    json list = json::array();
    for (const auto& [number, channel] : channels_) {
      json entry = handler_.describe(channel.stream);
      entry["channel"] = number;
      list.push_back(std::move(entry));
    }
    answer(client, {{"ok", true}, {"channels", list}, {"unreadable", unreadable_}}, id);
  } else {
    return false;
  }
  return true;
}

// Repeated while the client lives: another list replaces the one before.
void LiveServer::take_lead(Client& client, const JsonFields& named, const json& id) {
  const InstanceSet leads = handler_.read_lead(named);
  const double silence = named.number("silence_s", 1);
  if (!(silence >= kLeastSilence && silence <= kMostSilence)) named.expected("silence_s", "0.2 to 60");
  client.leads = leads;
  client.silence = std::chrono::nanoseconds(static_cast<std::int64_t>(1e9 * silence));
  if (!id.is_null()) answer(client, {{"ok", true}}, id);
}

void LiveServer::pass_records(Client& client, const JsonFields& named, const json& id) const {
  const SharedRecords* records = handler_.records();
  if (records == nullptr) named.refuse("this run shares no records: see its messages at the start");
  if (client.has_records) named.refuse("this connection has them already; open another one");
  client.has_records = true;
  client.line.send_with(
      to_line({{"id", id}, {"ok", true}, {"bytes", records->memory().size()}, {"hash", records->hash()}}),
      records->memory().file());
}

void LiveServer::poll_requests(Client& client) {
  for (auto request = client.requests.begin(); request != client.requests.end();) {
    auto done = handler_.poll(request->pending);
    if (!done) {
      ++request;
      continue;
    }
    answer(client, std::move(*done), request->id);
    request = client.requests.erase(request);
  }
}

void LiveServer::send_state(Client& client, Clock::time_point now, std::string& state) {
  if (client.period.count() == 0 || now < client.next_state) return;
  client.next_state = std::max(client.next_state + client.period, now);
  if (client.line.unsent() > kMaxUnread) {  // it reads too slowly
    client.gone = true;
    dropped_.fetch_add(1, std::memory_order_relaxed);
    return;
  }
  if (state.empty()) state = to_line(handler_.state());
  client.line.send("{\"state\":" + state + ",\"now_ns\":" + std::to_string(host_now().ns) +
                   ",\"subscription\":" + to_line(client.subscription) + "}");
}

void LiveServer::take_packets(Publisher& publisher) {
  constexpr int kPerTurn = 256;
  ChunkPacketBytes bytes;
  for (int n = 0; n < kPerTurn; ++n) {
    double age_s = 0;
    const std::ptrdiff_t size = receive_packet(publisher.file, bytes, realtime_(), age_s);
    if (gaps_.settles()) age_s = std::numeric_limits<double>::infinity();  // that clock may have been set
    if (size < 0 && errno == EINTR) continue;
    if (size < 0 && (errno == EAGAIN || errno == EWOULDBLOCK)) return;
    if (size <= 0) {
      publisher.gone = true;
      return;
    }
    const auto count = static_cast<std::size_t>(size);
    const auto packet = std::span(bytes.data(), std::min(count, bytes.size()));
    if (const auto sample = unpack(packet); sample && count == packet.size()) {
      take_packet(*sample, sample->channel, publisher, age_s);
    } else if (const auto chunk = unpack_chunk(packet); chunk && count == packet.size()) {
      take_packet(*chunk, chunk->head.channel, publisher, age_s);
    } else {
      ++unreadable_;
    }
  }
}

template <typename Packet>
void LiveServer::take_packet(const Packet& packet, std::uint32_t number, const Publisher& sender,
                             double age_s) {
  const auto found = channels_.find(number);
  if (found == channels_.end()) {
    ++unreadable_;
    return;
  }
  Channel& channel = found->second;
  const std::uint64_t received = channel.stream.received;
  handler_.deliver(packet, channel.stream, age_s);
  if (channel.stream.received != received) channel.sender = &sender;  // not by a packet out of order
  // Reported once per change, and not to an owner that does not read.
  if (channel.stream.verdict == channel.reported || channel.owner->line.unsent() > kMaxAhead) return;
  channel.reported = channel.stream.verdict;
  channel.owner->line.send(to_line({{"channel", number}, {"stream", handler_.describe(channel.stream)}}));
}

}  // namespace multipanda

#include "runtime/live_input/server.hpp"

#include <algorithm>
#include <cmath>
#include <poll.h>
#include <sys/eventfd.h>
#include <sys/socket.h>
#include <unistd.h>

namespace multipanda {
namespace {

using nlohmann::json;

constexpr auto kPollPeriod = std::chrono::microseconds(500);  // while an answer of the loop is pending
constexpr double kSlowest = 0.1, kFastest = 1000;             // of a subscription [Hz]

json refusal(const std::string& code, const std::string& reason) {
  return {{"ok", false}, {"verdict", code}, {"reason", reason}};
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
  while (!ending_.load(std::memory_order_acquire)) {
    wait();
    const auto now = Clock::now();
    for (Client& client : clients_) {
      poll_requests(client);
      send_state(client, now);
      client.line.flush();
      const bool done = client.line.input_ended() && client.requests.empty() && client.period.count() == 0 &&
                        !client.line.has_line() && client.line.unsent() == 0;
      client.gone = client.gone || client.line.broken() || done;
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
}

// Waits until something arrives or is due, and handles it.
void LiveServer::wait() {
  std::vector<pollfd> files{{wake_, POLLIN, 0}, {lines_, POLLIN, 0}};
  constexpr std::size_t kFixed = 2;
  std::chrono::nanoseconds timeout = std::chrono::seconds(1);
  const auto now = Clock::now();
  for (const Client& client : clients_) {
    int events = 0;
    if (!client.line.input_ended() && may_take(client)) events |= POLLIN;
    if (client.line.unsent() > 0) events |= POLLOUT;
    files.push_back({client.line.file(), static_cast<short>(events), 0});
    if (client.line.has_line() && may_take(client)) timeout = std::chrono::nanoseconds(0);
    if (!client.requests.empty()) timeout = std::min<std::chrono::nanoseconds>(timeout, kPollPeriod);
    if (client.period.count() > 0) {
      timeout =
          std::clamp<std::chrono::nanoseconds>(client.next_state - now, std::chrono::nanoseconds(0), timeout);
    }
  }
  for (const Publisher& publisher : publishers_) files.push_back({publisher.file, POLLIN, 0});
  files.push_back({packets_, POLLIN, 0});
  const timespec spec{.tv_sec = timeout.count() / 1'000'000'000, .tv_nsec = timeout.count() % 1'000'000'000};
  const std::size_t client_count = clients_.size();
  if (ppoll(files.data(), files.size(), &spec, nullptr) < 0) return;  // a signal
  // Packets are handled before requests and polled last, so their order with requests is kept.
  const std::size_t known = publishers_.size();
  if (files.back().revents != 0) accept_publishers();
  std::size_t k = kFixed + client_count;
  for (Publisher& publisher : publishers_) {
    if (k >= kFixed + client_count + known || files[k].revents != 0) take_packets(publisher);
    ++k;
  }
  k = kFixed;
  for (Client& client : clients_) {
    const short events = files[k++].revents;
    // Both directions are closed: earlier requests still count, answers are dropped.
    const bool closed = (events & (POLLHUP | POLLERR)) != 0;
    if ((events & POLLIN) != 0 || closed || may_take(client)) serve(client, closed);
    client.gone = client.gone || closed;
  }
  if (files[1].revents != 0) accept_clients();
}

bool LiveServer::may_take(const Client& client) const {
  return client.requests.size() < kMaxPending && client.line.unsent() < kMaxAhead;
}

void LiveServer::accept_clients() {
  for (;;) {
    const int file = accept4(lines_, nullptr, nullptr, SOCK_NONBLOCK | SOCK_CLOEXEC);
    if (file < 0) return;
    clients_.emplace_back(file);
    if (clients_.size() <= kMaxClients) continue;
    Client& client = clients_.back();
    answer(client, refusal("too_many_clients", "64 clients are connected: close one first"), nullptr);
    client.line.flush();
    clients_.pop_back();
  }
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

// `all`: the client has closed; handle everything that it has sent.
void LiveServer::serve(Client& client, bool all) {
  constexpr int kMostTurns = 64;  // a socket buffer holds fewer longest lines
  for (int turn = 0; turn < (all ? kMostTurns : 1); ++turn) {
    if (!client.line.input_ended()) client.line.receive();
    while (all || may_take(client)) {
      const auto line = client.line.next();
      if (!line) break;
      take_line(client, *line);
    }
    if (client.line.input_ended()) break;
  }
}

void LiveServer::answer(Client& client, json answer, const json& id) {
  answer["id"] = id;
  client.line.send(to_line(answer));
}

void LiveServer::take_line(Client& client, const LineConnection::Line& line) {
  json id;
  if (line.too_long) {
    answer(client, refusal("malformed", "a line has at most 65536 bytes"), id);
    return;
  }
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
    if (auto at_once = handler_.begin(request, started.pending)) {
      // Samples of a stream without an id are answered only if refused.
      if (at_once->contains("streamed") && id.is_null()) return;
      answer(client, std::move(*at_once), id);
    } else {
      client.requests.push_back(std::move(started));
    }
  } catch (const RequestRefused& refused) {
    answer(client, refusal(refused.code, refused.what()), id);
  } catch (const json::exception& wrong) {
    answer(client, refusal("malformed", std::string("not JSON: ") + wrong.what()), id);
  } catch (const std::exception& wrong) {
    answer(client, refusal("failed", wrong.what()), id);
  }
}

// Handles requests that concern the connection. Returns false for all others.
bool LiveServer::take_connection_request(Client& client, const json& request, const json& id) {
  const JsonFields fields(request, "request");
  const std::string word = fields.text("do");
  const JsonFields named(request, word);
  if (word == "subscribe") {
    named.allow({"id", "do", "rate_hz"});
    const double rate = named.number("rate_hz", 10);
    if (!(rate >= kSlowest && rate <= kFastest)) named.expected("rate_hz", "0.1 to 1000");
    client.period = std::chrono::nanoseconds(static_cast<std::int64_t>(1e9 / rate));
    client.next_state = Clock::now();
    client.subscription = id;
    answer(client, {{"ok", true}, {"rate_hz", rate}}, id);
  } else if (word == "unsubscribe") {
    named.allow({"id", "do"});
    client.period = {};
    answer(client, {{"ok", true}}, id);
  } else if (word == "records") {
    named.allow({"id", "do"});
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
    named.allow({"id", "do", "channel"});
    const double number = named.number("channel");
    const auto found = std::find_if(channels_.begin(), channels_.end(), [&](const auto& entry) {
      return entry.second.owner == &client && std::abs(entry.first - number) < 0.5;
    });
    if (found == channels_.end()) named.refuse("this connection has no such channel");
    answer(client, {{"ok", true}, {"channel", handler_.describe(found->second.stream)}}, id);
    handler_.discard(found->second.stream);
    channels_.erase(found);
  } else if (word == "channels") {
    named.allow({"id", "do"});
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

void LiveServer::send_state(Client& client, Clock::time_point now) {
  if (client.period.count() == 0 || now < client.next_state) return;
  client.next_state = std::max(client.next_state + client.period, now);
  if (client.line.unsent() > kMaxUnread) {  // it reads too slowly
    client.gone = true;
    dropped_.fetch_add(1, std::memory_order_relaxed);
    return;
  }
  client.line.send(to_line({{"subscription", client.subscription}, {"state", handler_.state()}}));
}

void LiveServer::take_packets(Publisher& publisher) {
  constexpr int kPerTurn = 256;
  ChunkPacketBytes bytes;
  for (int n = 0; n < kPerTurn; ++n) {
    double age_s = 0;
    const std::ptrdiff_t size = receive_packet(publisher.file, bytes, realtime_(), age_s);
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
  if (channel.stream.received != received) channel.sender = &sender;  // not by one that came out of order
  // Reported once per change, and not to an owner that does not read.
  if (channel.stream.verdict == channel.reported || channel.owner->line.unsent() > kMaxAhead) return;
  channel.reported = channel.stream.verdict;
  channel.owner->line.send(to_line({{"channel", number}, {"stream", handler_.describe(channel.stream)}}));
}

}  // namespace multipanda

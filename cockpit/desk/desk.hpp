#pragma once

#include <array>
#include <functional>
#include <list>
#include <memory>
#include <mutex>
#include <string>
#include <vector>

#include "cockpit/desk/source.hpp"
#include "cockpit/server/control.hpp"
#include "cockpit/server/dead_man.hpp"
#include "cockpit/server/hub.hpp"

namespace multipanda::cockpit {

// What clients of a cockpit see and may do (docs/cockpit_wire.md): states and news for everybody, one who
// commands, and motion only while that one holds a button.
class Desk final : public Hub::Handler {
 public:
  // Shows this source, or nothing. When this returns, the old one is not used any more. For any thread of
  // the program.
  void show(std::shared_ptr<Source> source, const std::string& reason = "the run has ended");
  // For a program that shows one run after the other. `call`: a Stop has come between two of them, or nobody
  // has resumed it when its run ended, so the next one must not begin. Called by any thread, the desk locked.
  // Without it, a Stop is refused while no run is shown.
  void on_owed_stop(std::function<void()> call);

  void join(Hub::Client& client, const nlohmann::json& id) override;
  void take(Hub::Client& client, const nlohmann::json& message) override;
  void leave(Hub::Client& client) override;
  std::chrono::nanoseconds turn(HostTime now) override;

 private:
  static constexpr std::size_t kMostPending = 64;        // requests of one client
  static constexpr std::uint32_t kMostAhead = 4;         // states beyond the last one that was seen
  static constexpr std::size_t kMostUnsent = 64 * 1024;  // bytes, for plots

  struct Pending {
    nlohmann::json id;
    std::string word;
    std::uint64_t stops = 0;  // stops_ when it came
    Later answer;
  };
  struct Seat {
    Hub::Client* client = nullptr;
    std::list<Pending> requests;
    std::chrono::nanoseconds period{0};  // of states; 0: none
    HostTime next_state, last_state, next_slow, next_list, next_plot;
    std::uint32_t frame = 0, seen = 0;          // numbers of states
    std::array<HostTime, kMostAhead + 1> sent;  // of the newest states, by their numbers
    HostTime seen_sent;                         // when the last one that was seen was sent
    std::uint64_t shown = 0;                    // Source::newest() of the last state
    std::uint64_t events = 0, list = 0;
    std::uint32_t plot_number = 0;
    Plot plot;
  };

  void leave_source(const std::string& reason);
  nlohmann::json owe_stop();
  Seat& seat_of(const Hub::Client& client);
  void greet(Seat& seat, const nlohmann::json& id);
  bool take_signal(Seat& seat, const nlohmann::json& message);
  void take_request(Seat& seat, const nlohmann::json& message, const nlohmann::json& id);
  bool take_own_request(Seat& seat, const nlohmann::json& message, const nlohmann::json& id);
  void take_control(Seat& seat, const nlohmann::json& message, const nlohmann::json& id);
  void take_plot(Seat& seat, const nlohmann::json& message, const nlohmann::json& id);
  void subscribe(Seat& seat, const nlohmann::json& message, const nlohmann::json& id);
  void poll(Seat& seat);
  void finish(Seat& seat, const Pending& request, Reply reply);
  void send_news(Seat& seat, HostTime now);
  void send_state(Seat& seat, HostTime now);
  void send_plot(Seat& seat, HostTime now);
  static bool lags(const Seat& seat, HostTime now);
  bool sees_now(const Seat& seat, HostTime now) const;
  void end_hold(const std::string& cause, std::optional<ClientId> holder);
  void send_control();
  nlohmann::json control_of(const Seat& seat) const;
  std::chrono::nanoseconds until_next(HostTime now) const;

  std::mutex mutex_;  // held while a member runs; show() waits for it
  std::shared_ptr<Source> source_;
  std::list<Seat> seats_;
  Control control_;
  DeadMan hold_;
  HostTime hold_ended_;  // by the desk itself
  bool held_before_ = false;
  std::uint64_t stops_ = 0, resumed_ = 0;  // Stops taken; of those, the ones that are no longer in force
  std::function<void()> owed_stop_;
};

}  // namespace multipanda::cockpit

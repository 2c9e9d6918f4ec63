#pragma once

#include <array>
#include <functional>
#include <list>
#include <memory>
#include <mutex>
#include <string>
#include <vector>

#include "cockpit/clients/source.hpp"
#include "cockpit/server/control.hpp"
#include "cockpit/server/hub.hpp"
#include "core/types/gap_watch.hpp"

namespace multipanda::cockpit {

// What clients of a cockpit receive and may do (cockpit/WIRE.md): states and events for all, control for one,
// and motion only while that one holds a button.
class Clients final : public Hub::Handler {
 public:
  // Shows this source, or nothing. After the return the old one is no longer used. For any thread of
  // the program.
  void show(std::shared_ptr<Source> source, const std::string& reason = "the run has ended");
  // For a program that shows one run after the other. `call`: a Stop arrived between two runs, or was not
  // resumed before its run ended, so the next run must not begin. Called by any thread, this object locked.
  // Without it, a Stop is refused while no run is shown.
  void on_stop_between_runs(std::function<void()> call);

  void join(Hub::Client& client, const nlohmann::json& id) override;
  bool is_urgent(const std::string& message) const override;
  bool outlasts(const std::string& message) override;
  void take(Hub::Client& client, const nlohmann::json& message, HostTime arrived) override;
  void leave(Hub::Client& client) override;
  std::chrono::nanoseconds turn(HostTime now) override;

 private:
  static constexpr std::size_t kMostPending = 64;        // requests of one client
  static constexpr std::uint32_t kMostAhead = 4;         // states beyond the last confirmed one
  static constexpr std::size_t kMostUnsent = 64 * 1024;  // bytes, for plots

  struct Pending {
    nlohmann::json id;
    std::string word;
    std::uint64_t stops = 0;  // stops_ when the request came
    Later answer;
  };
  struct Page {
    Hub::Client* client = nullptr;
    std::list<Pending> requests;
    std::chrono::nanoseconds period{0};  // of states; 0: none
    HostTime subscribed, next_state, last_state, next_slow, next_list, next_plot;
    std::uint32_t frame = 0, seen = 0;          // numbers of states
    std::array<HostTime, kMostAhead + 1> sent;  // of the newest states, by their numbers
    HostTime seen_sent;                         // send time of the last confirmed state
    std::uint64_t shown = 0;                    // Source::newest() of the last state
    std::uint64_t events = 0, list = 0;
    std::uint32_t plot_number = 0;
    Plot plot;
  };

  void leave_source(const std::string& reason);
  nlohmann::json stop_between_runs();
  Page& page_of(const Hub::Client& client);
  void send_hello(Page& page, const nlohmann::json& id);
  bool take_signal(Page& page, const nlohmann::json& message, bool late);
  void take_request(Page& page, const nlohmann::json& message, const nlohmann::json& id, HostTime arrived);
  bool take_own_request(Page& page, const nlohmann::json& message, const nlohmann::json& id);
  void take_control(Page& page, const nlohmann::json& message, const nlohmann::json& id);
  void take_plot(Page& page, const nlohmann::json& message, const nlohmann::json& id);
  void subscribe(Page& page, const nlohmann::json& message, const nlohmann::json& id);
  void poll(Page& page);
  void finish(Page& page, const Pending& request, Reply reply);
  void send_news(Page& page, HostTime now);
  void send_state(Page& page, HostTime now);
  void send_plot(Page& page, HostTime now);
  bool lags(const Page& page, HostTime now) const;
  bool sees_now(const Page& page, HostTime now) const;
  void end_hold(const std::string& cause, std::optional<ClientId> holder);
  void send_control();
  nlohmann::json control_of(const Page& page) const;
  std::chrono::nanoseconds until_next(HostTime now) const;

  std::mutex mutex_;  // held while a member runs; show() waits for it
  std::shared_ptr<Source> source_;
  std::list<Page> pages_;
  GapWatch gaps_;
  Control control_;
  DeadMan hold_;
  HostTime hold_ended_;  // by this object itself
  bool held_before_ = false;
  std::uint64_t stops_ = 0, resumed_ = 0;  // number of Stops, and of those that have ended
  std::function<void()> stop_between_runs_;
};

}  // namespace multipanda::cockpit

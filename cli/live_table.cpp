#include "cli/live_table.hpp"

#include <algorithm>
#include <cmath>

#include <fmt/format.h>

#include "core/state/arm_words.hpp"

namespace multipanda::cli {
namespace {

constexpr std::size_t kNewsLines = 6;
constexpr std::size_t kWidest = 100;

// Text never looks wider than `width`: ends in "~" where it was cut. ASCII only.
std::string fit(std::string text, std::size_t width) {
  if (text.size() <= width) return text;
  text.resize(width > 0 ? width - 1 : 0);
  text += '~';
  return text;
}

std::string painted(const std::string& text, const char* code, bool colour) {
  return colour ? fmt::format("\x1b[{}m{}\x1b[0m", code, text) : text;
}

std::string error_text(const ArmStatus& arm) {
  if (!arm.tracking_error || !std::isfinite(*arm.tracking_error)) return "-";
  if (std::string_view(arm.tracking_unit) == "m") return fmt::format("{:.2f} mm", *arm.tracking_error * 1e3);
  return fmt::format("{:.2f} mrad", *arm.tracking_error * 1e3);
}

// "move        100 %      0": an arm at the other end of a network.
std::string link_text(const ArmStatus& arm) {
  if (!arm.link) return fmt::format("{:<12} {:>7} {:>6}", "simulated", "-", "-");
  return fmt::format("{:<12} {:>5.0f} % {:>6}", to_string(arm.mode), 100 * arm.link->command_success_rate,
                     arm.link->lost);
}

std::string progress_bar(double share, std::size_t width) {
  const auto full = static_cast<std::size_t>(std::clamp(share, 0.0, 1.0) * static_cast<double>(width) + 0.5);
  return fmt::format("[{:#<{}}{:.<{}}]", "", full, "", width - full);
}

}  // namespace

std::vector<std::string> table_lines(const RunStatus& status, const std::string& scene, double duration_s,
                                     const TableStyle& style) {
  const std::size_t width = std::min(style.width, kWidest);
  const bool colour = style.colour;
  std::vector<std::string> lines;
  std::string head = fmt::format("{}  {:.1f} s", scene, status.time_s);
  if (duration_s > 0) {
    const double share = std::clamp(status.time_s / duration_s, 0.0, 1.0);
    head += fmt::format(" of {:g} s  {} {:.0f} %", duration_s, progress_bar(share, 30), 100 * share);
  } else {
    head += "  until Ctrl-C";
  }
  lines.push_back(painted(fit(head, width), "1", colour));
  lines.push_back(
      fit(fmt::format("loop {:.0f} Hz   cycle {:.1f} us (worst {:.1f})   overruns {}   cycles {}",
                      status.rate_hz, status.cycle_us, status.cycle_us_worst, status.overruns, status.cycles),
          width));
  lines.push_back("");
  const bool linked = std::any_of(status.arms.begin(), status.arms.end(),
                                  [](const auto& arm) { return arm.link.has_value(); });
  const std::size_t name = linked ? 12 : 14, controllet = linked ? 18 : 26;
  lines.push_back(
      painted(fit(fmt::format("{:<{}} {:<{}} {:>14} {:>10}  {}{}", "arm", name, "controllet", controllet,
                              "tracking error", "torque use",
                              linked ? fmt::format("{:<12} {:>7} {:>6}  ", "mode", "success", "lost") : "",
                              "interventions"),
                  width),
              "4", colour));
  // A table higher than the screen could not be redrawn in place: first the news give way, then arms.
  const std::size_t room = style.height > lines.size() + 1 ? style.height - lines.size() - 1 : 1;
  const std::size_t arms = status.arms.size() <= room ? status.arms.size() : room - 1;
  for (std::size_t i = 0; i < arms; ++i) {
    const ArmStatus& arm = status.arms[i];
    const std::string text =
        fit(fmt::format("{:<{}} {:<{}} {:>14} {:>8.0f} %  {}{}{}", fit(arm.arm, name), name,
                        fit(arm.controllet, controllet), controllet, error_text(arm), 100 * arm.torque_use,
                        linked ? link_text(arm) + "  " : "", arm.interventions,
                        arm.last_intervention.empty() ? "" : fmt::format(" ({})", arm.last_intervention)),
            width);
    lines.push_back(arm.last_intervention.empty() ? text : painted(text, "33", colour));
  }
  if (arms < status.arms.size())
    lines.push_back(fmt::format("... and {} more arms", status.arms.size() - arms));
  lines.push_back("");
  const std::size_t left = style.height > lines.size() ? style.height - lines.size() : 0;
  const std::size_t news = std::min(left, kNewsLines);
  const std::size_t first = status.news.size() - std::min(status.news.size(), news);
  for (std::size_t i = 0; i < news; ++i) {  // always as many lines: the table keeps its height
    lines.push_back(first + i < status.news.size() ? fit(status.news[first + i], width) : "");
  }
  return lines;
}

std::string plain_line(const RunStatus& status, double duration_s) {
  std::string line = fmt::format("{:9.3f} s", status.time_s);
  if (duration_s > 0) line += fmt::format("  {:.0f} %", 100 * std::min(1.0, status.time_s / duration_s));
  line += fmt::format("  {:.0f} Hz  cycle {:.1f} us  overruns {}", status.rate_hz, status.cycle_us,
                      status.overruns);
  for (const auto& arm : status.arms) {
    line +=
        fmt::format("  | {}: {} {} {:.0f} %", arm.arm, arm.controllet, error_text(arm), 100 * arm.torque_use);
    if (arm.link) {
      line += fmt::format(" {} success {:.0f} % lost {}", to_string(arm.mode),
                          100 * arm.link->command_success_rate, arm.link->lost);
    }
    if (arm.interventions > 0) line += fmt::format(" interventions {}", arm.interventions);
  }
  return line;
}

LiveDisplay::LiveDisplay(const Console& console, std::string scene, double duration_s)
    : console_(console), scene_(std::move(scene)), duration_s_(duration_s) {}

void LiveDisplay::show(const RunStatus& status) {
  if (console_.is_terminal()) {
    draw(status);
    return;
  }
  print_news(status);
  if (status.cycles == 0 || status.elapsed_s < next_line_s_) return;
  next_line_s_ = std::floor(status.elapsed_s) + 1;
  console_.line(plain_line(status, duration_s_));
}

void LiveDisplay::finish(const RunStatus& status) {
  if (console_.is_terminal()) {
    draw(status);
    return;
  }
  print_news(status);
  console_.line(plain_line(status, duration_s_));
}

// One write per picture, each line overwritten and cleared to its end: nothing flickers.
void LiveDisplay::draw(const RunStatus& status) {
  const auto lines = table_lines(
      status, scene_, duration_s_,
      {.width = console_.width() - 1, .height = console_.height() - 1, .colour = console_.has_colour()});
  std::string picture = drawn_ > 0 ? fmt::format("\x1b[{}A", drawn_) : "";
  for (const auto& line : lines) picture += "\r" + line + "\x1b[K\n";
  console_.raw(picture);
  drawn_ = lines.size();
}

void LiveDisplay::print_news(const RunStatus& status) {
  const std::uint64_t fresh = std::min<std::uint64_t>(status.events - told_, status.news.size());
  if (status.events - told_ > fresh) {
    console_.line(fmt::format("            ({} more events)", status.events - told_ - fresh));
  }
  for (auto i = status.news.size() - static_cast<std::size_t>(fresh); i < status.news.size(); ++i) {
    console_.line(status.news[i]);
  }
  told_ = status.events;
}

}  // namespace multipanda::cli

#include "cli/live_table.hpp"

#include <algorithm>
#include <cmath>
#include <deque>

#include <fmt/format.h>

#include "core/state/arm_state.hpp"

namespace multipanda::cli {
namespace {

constexpr std::size_t kNewsLines = 8;
constexpr std::size_t kWidest = 100;
constexpr std::size_t kIndent = 13;  // of a continued line: the width of its time

// Truncated to `width` columns, marked by "~". ASCII only.
std::string fit(std::string text, std::size_t width) {
  if (text.size() <= width) return text;
  text.resize(width > 0 ? width - 1 : 0);
  text += '~';
  return text;
}

// The text in lines of at most `width` columns, broken at spaces where possible.
std::vector<std::string> wrapped(std::string text, std::size_t width) {
  std::vector<std::string> lines;
  const std::size_t indent = width > 2 * kIndent ? kIndent : 0;
  while (text.size() > width) {
    const std::size_t space = text.rfind(' ', width);
    const std::size_t end = space == std::string::npos || space <= indent ? width : space;
    lines.push_back(text.substr(0, end));
    text = std::string(indent, ' ') + text.substr(std::min(text.find_first_not_of(' ', end), text.size()));
  }
  lines.push_back(text);
  return lines;
}

std::string painted(const std::string& text, const char* code, bool color) {
  return color ? fmt::format("\x1b[{}m{}\x1b[0m", code, text) : text;
}

std::string error_text(const ArmStatus& arm) {
  if (!arm.tracking_error || !std::isfinite(*arm.tracking_error)) return "-";
  const double error = *arm.tracking_error * 1e3;
  return fmt::format("{:.{}f} m{}", error, error < 100 ? 2 : 0, arm.tracking_unit);
}

// Fraction of answered commands, and lost packets, of an arm on the network.
std::string connection_text(const ArmStatus& arm) {
  if (!arm.connection) return fmt::format("{:>7} {:>5}", "-", "-");
  return fmt::format("{:>5.0f} % {:>5}", 100 * arm.connection->command_success_rate, arm.connection->lost);
}

std::string progress_bar(double share, std::size_t width) {
  const auto full = static_cast<std::size_t>(std::clamp(share, 0.0, 1.0) * static_cast<double>(width) + 0.5);
  return fmt::format("[{:#<{}}{:.<{}}]", "", full, "", width - full);
}

}  // namespace

std::vector<std::string> table_lines(const RunStatus& status, const std::string& scene, double duration_s,
                                     const TableStyle& style) {
  const std::size_t width = std::min(style.width, kWidest);
  const bool color = style.color;
  std::vector<std::string> lines;
  std::string head = fmt::format("{}  {:.1f} s", scene, status.time_s);
  if (duration_s > 0) {
    const double share = std::clamp(status.time_s / duration_s, 0.0, 1.0);
    head += fmt::format(" of {:g} s  {} {:.0f} %", duration_s, progress_bar(share, 30), 100 * share);
  } else {
    head += "  until Ctrl-C";
  }
  lines.push_back(painted(fit(head, width), "1", color));
  lines.push_back(
      fit(fmt::format("loop {:.0f} Hz   cycle {:.1f} us (worst {:.1f})   overruns {}   cycles {}",
                      status.rate_hz, status.cycle_us, status.cycle_us_worst, status.overruns, status.cycles),
          width));
  lines.push_back("");
  const bool connected = std::any_of(status.arms.begin(), status.arms.end(),
                                     [](const auto& arm) { return arm.connection.has_value(); });
  const std::size_t name = connected ? 9 : 12, controllet = connected ? 13 : 23;
  lines.push_back(painted(
      fit(fmt::format("{:<{}} {:<{}} {:>11} {:>6}  {:<12}{} {:>8}", "arm", name, "controllet", controllet,
                      "error", "torque", "mode", connected ? " success  lost" : "", "limited"),
          width),
      "4", color));
  // A table higher than the screen cannot be redrawn in place: messages are omitted first, then arms.
  const std::size_t room = style.height > lines.size() + 1 ? style.height - lines.size() - 1 : 1;
  const std::size_t arms = status.arms.size() <= room ? status.arms.size() : room - 1;
  for (std::size_t i = 0; i < arms; ++i) {
    const ArmStatus& arm = status.arms[i];
    const std::string text =
        fit(fmt::format("{:<{}} {:<{}} {:>11} {:>4.0f} %  {:<12}{} {:>8}", fit(arm.arm, name), name,
                        fit(arm.controllet, controllet), controllet, error_text(arm), 100 * arm.torque_use,
                        to_string(arm.mode), connected ? " " + connection_text(arm) : "", arm.interventions),
            width);
    const char* paint = !arm.errors.empty() ? "31" : arm.interventions > 0 ? "33" : "0";
    lines.push_back(painted(text, paint, color));
  }
  if (arms < status.arms.size())
    lines.push_back(fmt::format("... and {} more arms", status.arms.size() - arms));
  lines.push_back("");
  const std::size_t left = style.height > lines.size() ? style.height - lines.size() : 0;
  const std::size_t news = std::min(left, kNewsLines);
  std::deque<std::string> shown;
  for (auto text = status.news.rbegin(); text != status.news.rend() && shown.size() < news; ++text) {
    const auto pieces = wrapped(*text, width);
    shown.insert(shown.begin(), pieces.begin(), pieces.end());
  }
  while (shown.size() > news) shown.pop_front();
  shown.resize(news);  // constant number of lines: the table keeps its height
  lines.insert(lines.end(), shown.begin(), shown.end());
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
    if (arm.connection) {
      line += fmt::format(" {} success {:.0f} % lost {}", to_string(arm.mode),
                          100 * arm.connection->command_success_rate, arm.connection->lost);
    }
    if (!arm.errors.empty()) line += fmt::format(" stopped: {}", arm.errors);
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

// One write per update; each line is overwritten and cleared to its end, to avoid flicker.
void LiveDisplay::draw(const RunStatus& status) {
  const auto lines = table_lines(
      status, scene_, duration_s_,
      {.width = console_.width() - 1, .height = console_.height() - 1, .color = console_.has_color()});
  std::string picture = drawn_ > 0 ? fmt::format("\x1b[{}A", drawn_) : "";
  for (const auto& line : lines) picture += "\r" + line + "\x1b[K\n";
  console_.raw(picture);
  drawn_ = lines.size();
}

void LiveDisplay::print_news(const RunStatus& status) {
  const std::uint64_t added = std::min<std::uint64_t>(status.events - printed_, status.news.size());
  if (status.events - printed_ > added) {
    console_.line(fmt::format("            ({} more events)", status.events - printed_ - added));
  }
  for (auto i = status.news.size() - static_cast<std::size_t>(added); i < status.news.size(); ++i) {
    console_.line(status.news[i]);
  }
  printed_ = status.events;
}

}  // namespace multipanda::cli

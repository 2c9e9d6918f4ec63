#include "doctor/finding.hpp"

#include <algorithm>
#include <charconv>
#include <cmath>
#include <fstream>
#include <limits>
#include <sstream>

#include <fmt/format.h>
#include <nlohmann/json.hpp>

#include "common/text.hpp"
#include "core/types/statistics.hpp"

namespace multipanda::doctor {

namespace {

constexpr double kOwnCost_us = 150;  // a larger median is caused by the controllers
constexpr std::size_t kSubjectWidth = 24, kBarWidth = 48, kTextWidth = 110;

std::string_view color_of(Judgment judgment) {
  switch (judgment) {
    case Judgment::ok:
      return "\033[32m";
    case Judgment::unknown:
      return "\033[36m";
    case Judgment::warning:
      return "\033[33m";
    case Judgment::bad:
      return "\033[31m";
  }
  return "";
}

// Breaks a long sentence between words, with the following lines indented like the first.
void add_wrapped(std::vector<std::string>& lines, const std::string& head, const std::string& text) {
  std::string line = head;
  const std::string indent(head.size(), ' ');
  bool begun = false;
  std::size_t at = 0;
  while (at < text.size()) {
    const std::size_t end = std::min(text.find(' ', at), text.size());
    const std::string word = text.substr(at, end - at);
    if (begun && line.size() + 1 + word.size() > kTextWidth) {
      lines.push_back(line);
      line = indent;
      begun = false;
    }
    line += (begun ? " " : "") + word;
    begun = true;
    at = end + 1;
  }
  lines.push_back(line);
}

// A nonzero count has a bar of at least one character: rare late events matter.
std::string bar_line(const Bar& bar, std::size_t most) {
  const auto length = static_cast<std::size_t>(
      std::ceil(static_cast<double>(kBarWidth) * static_cast<double>(bar.count) / static_cast<double>(most)));
  const std::string range = std::isinf(bar.to) ? fmt::format("{:>6g} and more", bar.from)
                                               : fmt::format("{:>6g} to {:>5g}", bar.from, bar.to);
  return fmt::format("{:>28} us {:>8} {}", range, bar.count, std::string(length, '#'));
}

nlohmann::ordered_json number(double value) {
  if (!std::isfinite(value)) return nullptr;
  return std::round(value * 1e6) / 1e6;
}

const Finding* find(const std::vector<Finding>& findings, std::string_view id) {
  const auto at =
      std::find_if(findings.begin(), findings.end(), [&](const Finding& f) { return f.id == id; });
  return at == findings.end() ? nullptr : &*at;
}

double figure(const Finding& finding, std::string_view name) {
  for (const auto& each : finding.figures) {
    if (each.name == name) return each.value;
  }
  return 0;
}

bool is_wrong(const Finding* finding) {
  return finding != nullptr && (finding->judged == Judgment::warning || finding->judged == Judgment::bad);
}

// 1 2 5 10 ... 10000 us; the first and last bar take all smaller and larger values.
std::vector<double> edges() {
  std::vector<double> edges{0};
  for (double decade = 1; decade <= 1000; decade *= 10) {
    for (const double step : {1.0, 2.0, 5.0}) edges.push_back(step * decade);
  }
  edges.push_back(10000);
  edges.push_back(std::numeric_limits<double>::infinity());
  return edges;
}

}  // namespace

std::string_view to_string(Judgment judgment) {
  switch (judgment) {
    case Judgment::ok:
      return "ok";
    case Judgment::unknown:
      return "unknown";
    case Judgment::warning:
      return "warning";
    case Judgment::bad:
      return "bad";
  }
  return "?";
}

Finding& Finding::as(Judgment judgment, std::string why, std::string do_this) {
  judged = judgment;
  cause = std::move(why);
  cure = std::move(do_this);
  return *this;
}

void Finding::show(const Distribution& distribution) {
  figures = distribution.figures();
  histogram = distribution.bars;
}

Judgment verdict(const std::vector<Finding>& findings) {
  Judgment worst = Judgment::ok;
  for (const auto& finding : findings) worst = std::max(worst, finding.judged);
  return worst;
}

// A late torque has one of four causes: the computer's timers, other programs, the connection to the arm, or
// the controllers. A cause is named only for quantities that were late.
std::vector<std::string> blame(const std::vector<Finding>& findings) {
  std::vector<std::string> sentences;
  const auto wrong = [&](std::string_view id) { return is_wrong(find(findings, id)); };
  if (wrong("timer_wake_up")) {
    // Strongest first; several may apply at once.
    static constexpr std::pair<std::string_view, std::string_view> kReasons[] = {
        {"steal", "the host of this virtual machine runs other work on the processor"},
        {"sched_fifo", "the loop has no priority over other programs (no SCHED_FIFO)"},
        {"load", "other programs use the cores"},
        {"realtime_kernel", "the kernel cannot be preempted for the loop (no PREEMPT_RT)"},
        {"rt_throttling", "the kernel suspends real-time threads"},
        {"governor", "the processor changes its frequency"},
        {"idle_states", "the processor sleeps deeply between two cycles"},
        {"clock_source", "reading the clock is slow"},
        {"virtual_machine", "the timers of a virtual machine depend on its host"},
    };
    std::string reasons;
    for (const auto& [id, text] : kReasons) {
      if (wrong(id)) reasons += fmt::format("{}{}", reasons.empty() ? "" : "; ", text);
    }
    sentences.push_back(reasons.empty()
                            ? "this computer wakes the loop too late, and no examined cause explains it: "
                              "check for firmware interruptions (BIOS power saving, USB legacy support)"
                            : fmt::format("this computer wakes the loop too late: {}", reasons));
  }
  for (const auto& finding : findings) {
    if (!is_wrong(&finding)) continue;
    if (finding.id.starts_with("round_trip") || finding.id.starts_with("state_stream")) {
      sentences.push_back(
          wrong("timer_wake_up")
              ? fmt::format("{} is bad; this computer is late as well, so fix the computer first",
                            finding.subject)
              : fmt::format("the cause is the network, not this computer: {} ({})", finding.subject,
                            finding.measured));
    }
  }
  if (wrong("control_cycle")) {
    const Finding& cycle = *find(findings, "control_cycle");
    sentences.push_back(
        figure(cycle, "p50") > kOwnCost_us
            ? "the controllers of the scene take too long: use fewer features or a faster processor"
            : "the control cycle is fast, but other programs interrupt it");
  }
  if (wrong("loop_guard"))
    sentences.push_back("a controllet or feature allocates, locks or causes page faults in the loop");
  return sentences;
}

std::string to_json(const std::vector<Finding>& findings, Purpose purpose, double seconds) {
  nlohmann::ordered_json json;
  json["purpose"] = purpose == Purpose::real_arms ? "real_arms" : "simulated_arms";
  json["seconds"] = number(seconds);
  json["verdict"] = std::string(to_string(verdict(findings)));
  json["blame"] = blame(findings);
  json["findings"] = nlohmann::ordered_json::array();
  for (const auto& finding : findings) {
    nlohmann::ordered_json one{{"id", finding.id},
                               {"subject", finding.subject},
                               {"measured", finding.measured},
                               {"judged", std::string(to_string(finding.judged))},
                               {"cause", finding.cause},
                               {"cure", finding.cure}};
    one["figures"] = nlohmann::ordered_json::object();
    for (const auto& figure : finding.figures) {
      one["figures"][figure.name] = {{"value", number(figure.value)}, {"unit", figure.unit}};
    }
    if (!finding.histogram.empty()) {
      one["histogram"] = nlohmann::ordered_json::array();
      for (const auto& bar : finding.histogram) {
        one["histogram"].push_back(
            {{"from_us", number(bar.from)}, {"to_us", number(bar.to)}, {"count", bar.count}});
      }
    }
    json["findings"].push_back(std::move(one));
  }
  return json.dump();
}

std::vector<std::string> to_text(const Finding& finding, bool color) {
  std::vector<std::string> lines;
  const std::string judged = fmt::format("{:<8}", to_string(finding.judged));
  const std::string subject = fmt::format(" {:<{}} ", finding.subject, kSubjectWidth);
  add_wrapped(lines, judged + subject, finding.measured);
  if (color) {
    lines[0] = fmt::format("{}{}\033[0m{}", color_of(finding.judged), judged, lines[0].substr(judged.size()));
  }
  std::size_t most = 1;
  for (const auto& bar : finding.histogram) most = std::max(most, bar.count);
  for (const auto& bar : finding.histogram) lines.push_back(bar_line(bar, most));
  if (!finding.cause.empty()) add_wrapped(lines, "           cause: ", finding.cause);
  if (!finding.cure.empty()) add_wrapped(lines, "           cure:  ", finding.cure);
  return lines;
}

Distribution distribution_of(std::vector<double> us) {
  Distribution result;
  if (us.empty()) return result;
  result.count = us.size();
  result.p50 = quantile(us, 0.5);
  result.p99 = quantile(us, 0.99);
  result.p999 = quantile(us, 0.999);
  std::sort(us.begin(), us.end());
  result.worst = us.back();
  const auto steps = edges();
  for (std::size_t i = 0; i + 1 < steps.size(); ++i) {
    Bar bar{.from = steps[i], .to = steps[i + 1]};
    // A negative value (a clock that steps) counts as zero.
    const auto first = i == 0 ? us.begin() : std::lower_bound(us.begin(), us.end(), bar.from);
    bar.count = static_cast<std::size_t>(std::lower_bound(first, us.end(), bar.to) - first);
    result.bars.push_back(bar);
  }
  const auto filled = [](const Bar& bar) { return bar.count > 0; };
  result.bars.erase(result.bars.begin(), std::find_if(result.bars.begin(), result.bars.end(), filled));
  while (!result.bars.empty() && !filled(result.bars.back())) result.bars.pop_back();
  return result;
}

double share_above(const std::vector<double>& us, double limit) {
  if (us.empty()) return 0;
  const auto above = std::count_if(us.begin(), us.end(), [limit](double value) { return value > limit; });
  return static_cast<double>(above) / static_cast<double>(us.size());
}

std::vector<Figure> Distribution::figures() const {
  return {{"count", count, ""},
          {"p50", p50, "us"},
          {"p99", p99, "us"},
          {"p999", p999, "us"},
          {"worst", worst, "us"}};
}

std::string Distribution::text() const {
  const auto number = [](double us) {
    return us < 100 ? fmt::format("{:.3g}", us) : fmt::format("{:.0f}", us);
  };
  return fmt::format("p50 {}, p99 {}, p99.9 {}, worst {} us", number(p50), number(p99), number(p999),
                     number(worst));
}

bool SystemFiles::exists(const std::string& file) const {
  std::error_code error;
  return std::filesystem::exists(path(file), error);
}

std::optional<std::string> SystemFiles::text(const std::string& file) const {
  std::ifstream stream(path(file));
  if (!stream) return {};
  std::ostringstream content;
  content << stream.rdbuf();
  if (stream.bad()) return {};
  return content.str();
}

std::optional<std::string> SystemFiles::line(const std::string& file) const {
  std::ifstream stream(path(file));
  std::string line;
  if (!stream || !std::getline(stream, line)) return {};
  return std::string(trimmed(line));
}

std::optional<double> SystemFiles::number(const std::string& file) const {
  const auto text = line(file);
  if (!text) return {};
  double value = 0;
  const auto result = std::from_chars(text->data(), text->data() + text->size(), value);
  if (result.ec != std::errc()) return {};
  return value;
}

std::vector<std::string> SystemFiles::lines(const std::string& file) const {
  std::vector<std::string> lines;
  std::ifstream stream(path(file));
  for (std::string line; std::getline(stream, line);) lines.push_back(line);
  return lines;
}

std::vector<std::string> SystemFiles::names(const std::string& folder) const {
  std::vector<std::string> names;
  std::error_code error;
  for (const auto& entry : std::filesystem::directory_iterator(path(folder), error)) {
    names.push_back(entry.path().filename().string());
  }
  std::sort(names.begin(), names.end());
  return names;
}

std::vector<int> parse_core_list(const std::string& text) {
  std::vector<int> cores;
  std::istringstream parts(text);
  for (std::string part; std::getline(parts, part, ',');) {
    int first = 0, last = 0;
    const char* end = part.data() + part.size();
    const auto begin = std::from_chars(part.data(), end, first);
    if (begin.ec != std::errc()) continue;
    last = first;
    if (begin.ptr != end && *begin.ptr == '-') (void)std::from_chars(begin.ptr + 1, end, last);
    for (int core = first; core <= last && core - first < 4096; ++core) cores.push_back(core);
  }
  return cores;
}

}  // namespace multipanda::doctor

#include "cockpit/wire/http.hpp"

#include <algorithm>
#include <array>

#include <fmt/format.h>

namespace multipanda::cockpit {
namespace {

constexpr std::string_view kEnd = "\r\n\r\n";

// What a page may load and do. Scripts and styles come from its own files alone, and nobody frames it.
constexpr std::string_view kFixedHeaders =
    "Content-Security-Policy: default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' data: "
    "blob:; connect-src 'self'; font-src 'self'; base-uri 'none'; form-action 'none'; frame-ancestors "
    "'none'\r\n"
    "X-Frame-Options: DENY\r\n"
    "X-Content-Type-Options: nosniff\r\n"
    "Referrer-Policy: no-referrer\r\n"
    "Cross-Origin-Opener-Policy: same-origin\r\n"
    "Cross-Origin-Resource-Policy: same-origin\r\n"
    "Cache-Control: no-store\r\n";

char lower(char c) { return c >= 'A' && c <= 'Z' ? static_cast<char>(c - 'A' + 'a') : c; }

std::string lower(std::string_view text) {
  std::string out(text);
  std::ranges::transform(out, out.begin(), [](char c) { return lower(c); });
  return out;
}

std::string_view trimmed(std::string_view text) {
  const auto blank = [](char c) { return c == ' ' || c == '\t'; };
  while (!text.empty() && blank(text.front())) text.remove_prefix(1);
  while (!text.empty() && blank(text.back())) text.remove_suffix(1);
  return text;
}

// RFC 9110, section 5.6.2.
bool is_token(std::string_view text) {
  constexpr std::string_view kMarks = "!#$%&'*+-.^_`|~";
  return !text.empty() && std::ranges::all_of(text, [&](char c) {
    return (lower(c) >= 'a' && lower(c) <= 'z') || (c >= '0' && c <= '9') ||
           kMarks.find(c) != std::string_view::npos;
  });
}

bool is_visible(char c) { return c > ' ' && c < '\x7f'; }

bool is_text(char c) {
  return c == '\t' || (c >= ' ' && c != '\x7f') || static_cast<unsigned char>(c) >= 0x80;
}

}  // namespace

const std::string& HttpRequest::field(const std::string& name) const {
  static const std::string kNone;
  const auto found = fields.find(name);
  return found != fields.end() ? found->second : kNone;
}

HttpReader::Result HttpReader::refuse(int status, std::string reason) {
  status_ = status;
  reason_ = std::move(reason);
  return Result::refused;
}

HttpReader::Result HttpReader::take(std::string& bytes) {
  const std::size_t end = std::string_view(bytes).substr(0, kLongest).find(kEnd);
  if (end == std::string::npos) {
    if (bytes.size() < kLongest) return Result::incomplete;
    return refuse(431, "the head of a request has at most 8192 bytes");
  }
  const Result result = read_head(std::string_view(bytes).substr(0, end + 2));
  bytes.erase(0, end + kEnd.size());
  return result;
}

// `head`: lines, each with its end.
HttpReader::Result HttpReader::read_head(std::string_view head) {
  request_ = {};
  const auto next_line = [&] {
    const std::size_t end = head.find("\r\n");
    const std::string_view line = head.substr(0, end);
    head.remove_prefix(end + 2);
    return line;
  };
  const std::string_view first = next_line();
  const std::size_t space = first.find(' '), second = first.rfind(' ');
  if (space == std::string_view::npos || second == space)
    return refuse(400, "expected a request line: method, path and version");
  request_.method = first.substr(0, space);
  const std::string_view target = first.substr(space + 1, second - space - 1);
  const std::string_view version = first.substr(second + 1);
  if (!is_token(request_.method)) return refuse(400, "the method is not a word");
  if (target.empty() || target.front() != '/' || !std::ranges::all_of(target, is_visible))
    return refuse(400, "the path must begin with '/'");
  if (version != "HTTP/1.1" && version != "HTTP/1.0") return refuse(505, "HTTP/1.1 is spoken here");
  request_.path = target.substr(0, target.find('?'));
  while (!head.empty()) {
    if (request_.fields.size() == kMostFields) return refuse(431, "a request has at most 64 header fields");
    if (!read_field(next_line())) return Result::refused;
  }
  if (request_.has("transfer-encoding")) return refuse(501, "requests have no body here");
  if (request_.has("content-length") && request_.field("content-length") != "0")
    return refuse(413, "requests have no body here");
  if (request_.method != "GET" && request_.method != "HEAD")
    return refuse(405, "only GET and HEAD are answered");
  const std::string& connection = request_.field("connection");
  request_.keep_alive = version == "HTTP/1.1" ? !has_word(connection, "close") : false;
  return Result::request;
}

bool HttpReader::read_field(std::string_view line) {
  const std::size_t colon = line.find(':');
  // A blank before the colon, or at the begin of a line, is how requests are smuggled.
  if (colon == std::string_view::npos || !is_token(line.substr(0, colon))) {
    refuse(400, "a header field is 'Name: value'");
    return false;
  }
  const std::string_view value = trimmed(line.substr(colon + 1));
  if (!std::ranges::all_of(value, is_text)) {
    refuse(400, "a header field has a control character");
    return false;
  }
  // Two values of a field that decides something are two opinions about it.
  const bool added = request_.fields.emplace(lower(line.substr(0, colon)), value).second;
  if (!added) refuse(400, fmt::format("the header field '{}' is there twice", line.substr(0, colon)));
  return added;
}

bool has_word(std::string_view list, std::string_view word) {
  while (!list.empty()) {
    const std::size_t comma = list.find(',');
    if (lower(trimmed(list.substr(0, comma))) == lower(word)) return true;
    if (comma == std::string_view::npos) return false;
    list.remove_prefix(comma + 1);
  }
  return false;
}

bool is_own_host(std::string_view host) {
  constexpr std::array<std::string_view, 3> kNames{"127.0.0.1", "localhost", "[::1]"};
  return std::ranges::any_of(kNames, [&](std::string_view name) {
    if (lower(host.substr(0, name.size())) != name) return false;
    const std::string_view rest = host.substr(name.size());
    if (rest.empty()) return true;
    return rest.size() >= 2 && rest.size() <= 6 && rest.front() == ':' &&
           std::ranges::all_of(rest.substr(1), [](char c) { return c >= '0' && c <= '9'; });
  });
}

bool is_own_origin(std::string_view origin, std::string_view host) {
  constexpr std::string_view kScheme = "http://";
  return origin.starts_with(kScheme) && lower(origin.substr(kScheme.size())) == lower(host);
}

std::string_view status_text(int status) {
  switch (status) {
    case 200:
      return "OK";
    case 400:
      return "Bad Request";
    case 403:
      return "Forbidden";
    case 404:
      return "Not Found";
    case 405:
      return "Method Not Allowed";
    case 408:
      return "Request Timeout";
    case 413:
      return "Content Too Large";
    case 426:
      return "Upgrade Required";
    case 431:
      return "Request Header Fields Too Large";
    case 501:
      return "Not Implemented";
    case 503:
      return "Service Unavailable";
    case 505:
      return "HTTP Version Not Supported";
    default:
      return "Error";
  }
}

std::string http_answer(int status, std::string_view type, std::string_view body, bool keep_alive,
                        bool head_only) {
  std::string answer =
      fmt::format("HTTP/1.1 {} {}\r\n{}{}Content-Type: {}\r\nContent-Length: {}\r\nConnection: {}\r\n\r\n",
                  status, status_text(status), kFixedHeaders, status == 405 ? "Allow: GET, HEAD\r\n" : "",
                  type, body.size(), keep_alive ? "keep-alive" : "close");
  if (!head_only) answer += body;
  return answer;
}

}  // namespace multipanda::cockpit

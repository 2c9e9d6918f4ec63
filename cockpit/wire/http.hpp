#pragma once

#include <cstdint>
#include <map>
#include <string>
#include <string_view>

namespace multipanda::cockpit {

// A subset of HTTP/1.1 (RFC 9112): requests without a body, one after the other.
struct HttpRequest {
  std::string method, path;                   // path without the query
  std::map<std::string, std::string> fields;  // names in lower case
  bool keep_alive = true;

  // Its value, or an empty text.
  const std::string& field(const std::string& name) const;
  bool has(const std::string& name) const { return fields.contains(name); }
};

// Reads the head of a request from bytes as they arrive.
class HttpReader {
 public:
  static constexpr std::size_t kLongest = 8 * 1024;  // of a head
  static constexpr std::size_t kMostFields = 64;

  enum class Result { incomplete, request, refused };

  // Takes the request at the begin of `bytes` and removes it from them.
  Result take(std::string& bytes);
  const HttpRequest& request() const { return request_; }
  int status() const { return status_; }                 // of a refusal: 400, 405, 413, 431, 501, 505
  const std::string& reason() const { return reason_; }  // for the client

 private:
  Result refuse(int status, std::string reason);
  Result read_head(std::string_view head);
  bool read_field(std::string_view line);

  HttpRequest request_;
  int status_ = 0;
  std::string reason_;
};

// Whether the text of a field such as `Connection` has this word in its list, in any case.
bool has_word(std::string_view list, std::string_view word);

// What browsers know this server by: 127.0.0.1, localhost or [::1], with a port or without. Any other name
// that resolves to this computer is a foreign page's (DNS rebinding).
bool is_own_host(std::string_view host);

// Whether a page of this origin was served under this host: "http://" and the host.
bool is_own_origin(std::string_view origin, std::string_view host);

// An answer with the headers that every answer has: what a page may load, and that nobody may frame it.
// `head_only`: without the body, as for HEAD.
std::string http_answer(int status, std::string_view type, std::string_view body, bool keep_alive,
                        bool head_only = false);

std::string_view status_text(int status);

}  // namespace multipanda::cockpit

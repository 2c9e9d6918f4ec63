#include "cockpit/wire/http.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace multipanda::cockpit::http_test {
namespace {

using testing::HasSubstr;
using Result = HttpReader::Result;

// The status of a refusal, 0 for a request, -1 if it is incomplete.
int status_of(std::string bytes) {
  HttpReader reader;
  const Result result = reader.take(bytes);
  return result == Result::refused ? reader.status() : result == Result::request ? 0 : -1;
}

std::string with(const std::string& fields) { return "GET / HTTP/1.1\r\n" + fields + "\r\n"; }

TEST(HttpReader, ReadsARequest) {
  HttpReader reader;
  std::string bytes = "GET /app.js?v=1 HTTP/1.1\r\nHost: localhost:8080\r\nX-Thing: \t a b \r\n\r\nnext";
  ASSERT_EQ(reader.take(bytes), Result::request);
  EXPECT_EQ(reader.request().method, "GET");
  EXPECT_EQ(reader.request().path, "/app.js");
  EXPECT_EQ(reader.request().field("host"), "localhost:8080");
  EXPECT_EQ(reader.request().field("x-thing"), "a b");
  EXPECT_EQ(reader.request().field("absent"), "");
  EXPECT_TRUE(reader.request().keep_alive);
  EXPECT_EQ(bytes, "next");
}

TEST(HttpReader, ReadsByteByByte) {
  const std::string whole = with("Host: a\r\nConnection: close\r\n");
  HttpReader reader;
  std::string bytes;
  for (std::size_t i = 0; i < whole.size(); ++i) {
    bytes += whole[i];
    ASSERT_EQ(reader.take(bytes), i + 1 < whole.size() ? Result::incomplete : Result::request) << i;
  }
  EXPECT_FALSE(reader.request().keep_alive);
}

TEST(HttpReader, RefusesWhatItDoesNotSpeak) {
  EXPECT_EQ(status_of(with("")), 0);
  EXPECT_EQ(status_of("POST / HTTP/1.1\r\n\r\n"), 405);
  EXPECT_EQ(status_of("GET / HTTP/2.0\r\n\r\n"), 505);
  EXPECT_EQ(status_of("GET /\r\n\r\n"), 400);
  EXPECT_EQ(status_of("GET http://other/ HTTP/1.1\r\n\r\n"), 400);
  EXPECT_EQ(status_of("GET /a b HTTP/1.1\r\n\r\n"), 400);
  EXPECT_EQ(status_of("G(T / HTTP/1.1\r\n\r\n"), 400);
  EXPECT_EQ(status_of(with("Transfer-Encoding: chunked\r\n")), 501);
  EXPECT_EQ(status_of(with("Content-Length: 5\r\n")), 413);
  EXPECT_EQ(status_of(with("Content-Length: 0\r\n")), 0);
}

// Requests that two programs in a row may understand differently (RFC 9112, section 11.2).
TEST(HttpReader, RefusesAmbiguousFields) {
  EXPECT_EQ(status_of(with("Host : a\r\n")), 400);
  EXPECT_EQ(status_of(with(" Host: a\r\n")), 400);
  EXPECT_EQ(status_of(with("Host: a\r\nhost: b\r\n")), 400);
  EXPECT_EQ(status_of(with("Host\r\n")), 400);
  EXPECT_EQ(status_of(with("A: b\nHost: c\r\n")), 400);
  EXPECT_EQ(status_of(with(std::string("A: b\0c\r\n", 8))), 400);
}

TEST(HttpReader, BoundsTheHead) {
  std::string fields;
  for (std::size_t i = 0; i < HttpReader::kMostFields; ++i) fields += "F" + std::to_string(i) + ": x\r\n";
  EXPECT_EQ(status_of(with(fields)), 0);
  EXPECT_EQ(status_of(with(fields + "G: x\r\n")), 431);
  EXPECT_EQ(status_of("GET /" + std::string(HttpReader::kLongest - 6, 'a')), -1);
  EXPECT_EQ(status_of("GET /" + std::string(HttpReader::kLongest, 'a')), 431);
}

TEST(Host, OnlyThisComputerByItsOwnNames) {
  for (const char* own : {"127.0.0.1", "127.0.0.1:8080", "localhost", "LocalHost:1", "[::1]", "[::1]:65535"})
    EXPECT_TRUE(is_own_host(own)) << own;
  for (const char* foreign : {"", "127.0.0.2", "127.0.0.1.evil.example", "localhost.evil.example",
                              "evil.example:8080", "127.0.0.1:", "127.0.0.1:80a", "localhost:123456", "::1",
                              "[::1", "127.0.0.1:80@evil", "0.0.0.0", "2130706433"})
    EXPECT_FALSE(is_own_host(foreign)) << foreign;
}

TEST(Origin, IsTheHostsOwn) {
  EXPECT_TRUE(is_own_origin("http://localhost:8080", "localhost:8080"));
  EXPECT_TRUE(is_own_origin("http://LOCALHOST", "localhost"));
  for (const char* foreign :
       {"", "null", "http://localhost", "https://localhost:8080", "http://127.0.0.1:8080",
        "http://localhost:8080/", "http://localhost:80800", "http://evil.example"})
    EXPECT_FALSE(is_own_origin(foreign, "localhost:8080")) << foreign;
}

TEST(Answer, LetsNobodyFrameIt) {
  const std::string answer = http_answer(200, "text/html", "<p>", true);
  EXPECT_THAT(answer, HasSubstr("HTTP/1.1 200 OK\r\n"));
  EXPECT_THAT(answer, HasSubstr("frame-ancestors 'none'"));
  EXPECT_THAT(answer, HasSubstr("default-src 'none'"));
  EXPECT_THAT(answer, HasSubstr("Content-Length: 3\r\n"));
  EXPECT_TRUE(answer.ends_with("\r\n\r\n<p>"));
  EXPECT_TRUE(http_answer(200, "text/html", "<p>", true, true).ends_with("\r\n\r\n"));
  EXPECT_THAT(http_answer(405, "text/plain", "", false), HasSubstr("Allow: GET, HEAD\r\n"));
}

TEST(Words, AreFoundInLists) {
  EXPECT_TRUE(has_word("keep-alive, Upgrade", "upgrade"));
  EXPECT_TRUE(has_word("upgrade", "upgrade"));
  EXPECT_FALSE(has_word("upgraded, up", "upgrade"));
  EXPECT_FALSE(has_word("", "upgrade"));
}

}  // namespace
}  // namespace multipanda::cockpit::http_test

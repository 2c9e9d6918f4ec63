#pragma once

#include <optional>
#include <string>

namespace multipanda {

// One end of a socket that carries lines. Owns the descriptor, which must be non-blocking. For one thread.
class LineConnection {
 public:
  // `longest`: largest number of bytes of a line, without its end.
  LineConnection(int file, std::size_t longest) : file_(file), longest_(longest) {}
  ~LineConnection();
  LineConnection(const LineConnection&) = delete;

  int file() const { return file_; }

  // Reads the data that has arrived, at most about one longest line. Returns whether something came.
  bool receive();
  struct Line {
    std::string text;
    bool too_long = false;  // the rest of the line is dropped
  };
  std::optional<Line> next();  // the next whole line; the rest before the end of the input counts as one
  bool input_ended() const { return input_ended_; }
  // Whether the other end has closed both directions; one that has only ended its sending still reads. A
  // system call.
  bool hung_up() const;

  void send(const std::string& line);  // adds the end of the line; kept until it can be sent
  // The same with a descriptor, which stays the caller's and must stay open until the line is sent. At most
  // once per connection: descriptors in transit are limited per user.
  void send_with(const std::string& line, int passed);
  void flush();  // sends as much as is possible without waiting
  std::size_t unsent() const { return out_.size() - sent_; }
  bool broken() const { return broken_; }  // the other end has closed

 private:
  int file_;
  std::size_t longest_;
  std::string in_, out_;
  std::size_t begin_ = 0, scanned_ = 0, sent_ = 0;  // of in_: its first line, the searched part
  int passed_ = -1;                                 // descriptor to send; -1: none
  std::size_t passed_from_ = 0;                     // with this byte of out_
  bool skipping_ = false, input_ended_ = false, broken_ = false;
};

}  // namespace multipanda

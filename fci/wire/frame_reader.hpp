#pragma once

#include <cstddef>
#include <span>
#include <vector>

#include "fci/wire/commands.hpp"

// Cuts a TCP byte stream into messages, however the bytes arrive, and whatever they are.
//
//   const auto room = reader.room();                       // never empty once next() said `incomplete`
//   const ssize_t n = recv(fd, room.data(), room.size(), 0);
//   reader.received(n);
//   while (reader.next(message) == FrameReader::Next::message) ...
//
// One thread. Memory is taken in the constructor (`reserve` bytes); above that it grows with the bytes that
// have really arrived, never by what a header claims, and never beyond the larger of `reserve` and
// `max_size`.
namespace multipanda::fci {

struct Message {
  std::uint32_t command = 0;
  std::uint32_t command_id = 0;
  std::span<const std::byte> payload;  // valid until the next call of the reader
};

class FrameReader {
 public:
  enum class Next : std::uint8_t {
    message,     // one is there
    incomplete,  // more bytes are needed
    bad_size,    // a header announces less than itself or more than max_size: where the next message would
                 // begin is unknown. Stays so until reset().
  };

  // `max_size`: of a whole message [bytes].
  FrameReader(HeaderKind kind, std::size_t max_size, std::size_t reserve = 4096);

  std::span<std::byte> room();
  void received(std::size_t bytes);  // at most as many as room() had
  Next next(Message& message);
  void reset();  // for a new connection

  std::size_t waiting() const { return end_ - begin_; }  // bytes not yet handed out

 private:
  HeaderKind kind_;
  std::size_t max_size_;
  std::vector<std::byte> buffer_;
  std::size_t begin_ = 0, end_ = 0;  // bytes not yet handed out
  bool broken_ = false;
};

}  // namespace multipanda::fci

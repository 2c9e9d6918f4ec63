#pragma once

#include <cstddef>
#include <span>
#include <vector>

#include "fci/wire/commands.hpp"

// Splits a TCP byte stream, received in arbitrary pieces, into messages.
//
//   const auto room = reader.room();                       // never empty once next() said `incomplete`
//   const ssize_t n = recv(fd, room.data(), room.size(), 0);
//   reader.received(n);
//   while (reader.next(message) == FrameReader::Next::message) ...
//
// One thread. The constructor allocates `reserve` bytes. Above that, memory grows with the bytes that have
// arrived, never with the size that a header claims, and never beyond the larger of `reserve` and `max_size`.
namespace multipanda::fci {

struct Message {
  std::uint32_t command = 0;
  std::uint32_t command_id = 0;
  std::span<const std::byte> payload;  // valid until the next call of the reader
};

class FrameReader {
 public:
  enum class Next : std::uint8_t {
    message,     // a message is available
    incomplete,  // more bytes are needed
    bad_size,    // a header announces a size below its own or above max_size: the begin of the next
                 // message is unknown. Stays so until reset().
  };

  // `max_size`: of a whole message [bytes].
  FrameReader(HeaderKind kind, std::size_t max_size, std::size_t reserve = 4096);

  std::span<std::byte> room();
  void received(std::size_t bytes);  // at most the size of room()
  Next next(Message& message);
  void reset();  // for a new connection

  std::size_t waiting() const { return end_ - begin_; }  // bytes not yet returned

 private:
  HeaderKind kind_;
  std::size_t max_size_;
  std::vector<std::byte> buffer_;
  std::size_t begin_ = 0, end_ = 0;  // bytes not yet returned
  bool broken_ = false;
};

}  // namespace multipanda::fci

#include "fci/wire/frame_reader.hpp"

#include <algorithm>
#include <cstring>
#include <stdexcept>
#include <string>

namespace multipanda::fci {

FrameReader::FrameReader(HeaderKind kind, std::size_t max_size, std::size_t reserve)
    : kind_(kind), max_size_(max_size), buffer_(std::max<std::size_t>(reserve, 2 * header_size(kind))) {
  if (max_size < header_size(kind))
    throw std::invalid_argument("FrameReader: max_size must hold a header of " +
                                std::to_string(header_size(kind)) + " bytes, got " +
                                std::to_string(max_size));
}

std::span<std::byte> FrameReader::room() {
  if (begin_ > 0) {
    std::memmove(buffer_.data(), buffer_.data() + begin_, waiting());
    end_ -= begin_;
    begin_ = 0;
  }
  // Full: one incomplete message, unless the caller did not collect complete ones.
  if (end_ == buffer_.size() && end_ < max_size_) buffer_.resize(std::min(2 * end_, max_size_));
  return std::span(buffer_).subspan(end_);
}

void FrameReader::received(std::size_t bytes) { end_ = std::min(end_ + bytes, buffer_.size()); }

FrameReader::Next FrameReader::next(Message& message) {
  if (broken_) return Next::bad_size;
  MessageHeader header;
  const auto there = std::span<const std::byte>(buffer_).subspan(begin_, waiting());
  if (decode(kind_, there, header) != WireResult::ok) return Next::incomplete;
  if (header.size < header_size(kind_) || header.size > max_size_) {
    broken_ = true;
    return Next::bad_size;
  }
  if (header.size > there.size()) return Next::incomplete;
  message = {header.command, header.command_id,
             there.subspan(header_size(kind_), header.size - header_size(kind_))};
  begin_ += header.size;
  return Next::message;
}

void FrameReader::reset() {
  begin_ = end_ = 0;
  broken_ = false;
}

}  // namespace multipanda::fci

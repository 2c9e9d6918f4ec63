#pragma once

#include <cstddef>
#include <string>

namespace multipanda {

// Memory that this process writes and that others, with its descriptor, can only read. Seals fix its size and
// prevent later writable mappings: no reader can change the contents or truncate the memory. All pages are
// allocated from the start, so that no write waits for one.
class SealedMemory {
 public:
  // `name`: shown in /proc. Throws std::runtime_error, for example on a kernel before 5.1.
  SealedMemory(const std::string& name, std::size_t bytes);
  ~SealedMemory();
  SealedMemory(const SealedMemory&) = delete;
  SealedMemory& operator=(const SealedMemory&) = delete;

  std::byte* data() const { return data_; }
  std::size_t size() const { return size_; }
  int file() const { return file_; }  // descriptor to pass on

 private:
  int file_ = -1;
  std::byte* data_ = nullptr;
  std::size_t size_;
};

}  // namespace multipanda

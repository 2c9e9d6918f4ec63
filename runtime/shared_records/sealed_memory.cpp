#include "runtime/shared_records/sealed_memory.hpp"

#include <cerrno>
#include <fcntl.h>
#include <stdexcept>
#include <sys/mman.h>
#include <system_error>
#include <unistd.h>

namespace multipanda {

SealedMemory::SealedMemory(const std::string& name, std::size_t bytes) : size_(bytes) {
  const auto failed = [this](const char* step) {
    const std::string why = std::generic_category().message(errno);
    if (data_ != nullptr) munmap(data_, size_);
    if (file_ >= 0) close(file_);
    throw std::runtime_error("shared memory of " + std::to_string(size_) + " bytes: " + step + ": " + why);
  };
  file_ = memfd_create(name.c_str(), MFD_CLOEXEC | MFD_ALLOW_SEALING);
  if (file_ < 0) failed("memfd_create");
  if (ftruncate(file_, static_cast<off_t>(bytes)) != 0) failed("ftruncate");
  void* mapped = mmap(nullptr, bytes, PROT_READ | PROT_WRITE, MAP_SHARED | MAP_POPULATE, file_, 0);
  if (mapped == MAP_FAILED) failed("mmap");
  data_ = static_cast<std::byte*>(mapped);
  // After the mapping above, which remains the only writable one.
  if (fcntl(file_, F_ADD_SEALS, F_SEAL_SHRINK | F_SEAL_GROW | F_SEAL_FUTURE_WRITE | F_SEAL_SEAL) != 0)
    failed("seals (Linux 5.1 or newer has them)");
}

SealedMemory::~SealedMemory() {
  munmap(data_, size_);
  close(file_);
}

}  // namespace multipanda

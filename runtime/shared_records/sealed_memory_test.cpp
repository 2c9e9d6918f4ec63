#include <cerrno>
#include <cstring>
#include <fcntl.h>
#include <string>
#include <sys/mman.h>
#include <unistd.h>

#include <gtest/gtest.h>

#include "runtime/shared_records/shared_records.hpp"

namespace multipanda::sealed_memory_test {
namespace {

class Sealed : public testing::Test {
 protected:
  Sealed() : memory_("multipanda-test", 8192), reader_(dup(memory_.file())) {
    std::memset(memory_.data(), 7, memory_.size());
  }
  ~Sealed() override { close(reader_); }
  void expect_untouched() {
    for (std::size_t i = 0; i < memory_.size(); ++i) ASSERT_EQ(memory_.data()[i], std::byte{7}) << i;
    EXPECT_EQ(lseek(reader_, 0, SEEK_END), 8192);
  }

  SealedMemory memory_;
  int reader_;
};

TEST_F(Sealed, WritesOfTheOwnerReachReaders) {
  void* view = mmap(nullptr, 8192, PROT_READ, MAP_SHARED, reader_, 0);
  ASSERT_NE(view, MAP_FAILED);
  memory_.data()[5000] = std::byte{42};
  EXPECT_EQ(static_cast<const unsigned char*>(view)[5000], 42);
  munmap(view, 8192);
}

TEST_F(Sealed, NobodyElseWrites) {
  const char byte = 0;
  EXPECT_LT(write(reader_, &byte, 1), 0);
  EXPECT_LT(pwrite(reader_, &byte, 1, 100), 0);
  EXPECT_EQ(mmap(nullptr, 8192, PROT_READ | PROT_WRITE, MAP_SHARED, reader_, 0), MAP_FAILED);
  void* view = mmap(nullptr, 8192, PROT_READ, MAP_SHARED, reader_, 0);
  ASSERT_NE(view, MAP_FAILED);
  EXPECT_NE(mprotect(view, 8192, PROT_READ | PROT_WRITE), 0);
  EXPECT_NE(madvise(view, 8192, MADV_REMOVE), 0);
  munmap(view, 8192);
  EXPECT_NE(fallocate(reader_, FALLOC_FL_PUNCH_HOLE | FALLOC_FL_KEEP_SIZE, 0, 4096), 0);
  expect_untouched();
}

// Opened again it has a descriptor for writing, which the seals still forbid.
TEST_F(Sealed, NorAfterOpeningItAgain) {
  const int again = open(("/proc/self/fd/" + std::to_string(reader_)).c_str(), O_RDWR);
  if (again >= 0) {
    const char byte = 0;
    EXPECT_LT(pwrite(again, &byte, 1, 0), 0);
    EXPECT_EQ(mmap(nullptr, 8192, PROT_READ | PROT_WRITE, MAP_SHARED, again, 0), MAP_FAILED);
    EXPECT_NE(ftruncate(again, 0), 0);
    close(again);
  } else {
    EXPECT_TRUE(errno == EACCES || errno == EPERM || errno == ENOENT) << errno;
  }
  const int cut = open(("/proc/self/fd/" + std::to_string(reader_)).c_str(), O_RDWR | O_TRUNC);
  if (cut >= 0) close(cut);
  expect_untouched();
}

TEST_F(Sealed, NobodyChangesItsSizeOrSeals) {
  EXPECT_NE(ftruncate(reader_, 0), 0);
  EXPECT_NE(ftruncate(reader_, 4096), 0);
  EXPECT_NE(ftruncate(reader_, 1 << 20), 0);
  EXPECT_NE(fcntl(reader_, F_ADD_SEALS, F_SEAL_WRITE), 0);
  memory_.data()[0] = std::byte{7};  // its owner still writes
  expect_untouched();
}

TEST_F(Sealed, AllPagesAreThereFromTheStart) {
  const SealedMemory fresh("multipanda-test", 64 * 4096);
  unsigned char resident[64] = {};
  ASSERT_EQ(mincore(fresh.data(), fresh.size(), resident), 0);
  for (const unsigned char page : resident) EXPECT_EQ(page & 1, 1);
}

}  // namespace
}  // namespace multipanda::sealed_memory_test

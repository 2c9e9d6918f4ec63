#include "core/rt/guard/loop_guard.hpp"

#include <cerrno>
#include <cstdarg>
#include <cstddef>
#include <ctime>
#include <dlfcn.h>
#include <pthread.h>
#include <semaphore.h>
#include <sys/resource.h>
#include <sys/syscall.h>

namespace multipanda {
namespace {

struct ThreadCounts {
  bool armed;
  std::uint64_t heap, locks;
};
// With initial-exec, reading it never allocates, even in the first malloc of a thread.
thread_local ThreadCounts counts __attribute__((tls_model("initial-exec"))) = {false, 0, 0};

std::uint64_t faults_so_far() {
  rusage usage{};
  getrusage(RUSAGE_THREAD, &usage);
  return static_cast<std::uint64_t>(usage.ru_minflt + usage.ru_majflt);
}
thread_local std::uint64_t faults_at_start __attribute__((tls_model("initial-exec"))) = 0;

}  // namespace

void LoopGuard::arm() {
  faults_at_start = faults_so_far();
  counts = {true, 0, 0};
}

LoopGuardCounts LoopGuard::disarm() {
  counts.armed = false;
  return {counts.heap, counts.locks, faults_so_far() - faults_at_start};
}

}  // namespace multipanda

#if !defined(__SANITIZE_ADDRESS__) && !defined(__SANITIZE_THREAD__) && !defined(MULTIPANDA_NO_LOOP_GUARD)

namespace {

void count_heap() {
  if (multipanda::counts.armed) ++multipanda::counts.heap;
}
void count_lock() {
  if (multipanda::counts.armed) ++multipanda::counts.locks;
}

// The original function. It is looked up before main (see Primer), because dlsym allocates.
template <typename Function>
Function* real(const char* name) {
  return reinterpret_cast<Function*>(dlsym(RTLD_NEXT, name));
}

}  // namespace

extern "C" {

void* __libc_malloc(std::size_t);
void __libc_free(void*);
void* __libc_calloc(std::size_t, std::size_t);
void* __libc_realloc(void*, std::size_t);
void* __libc_memalign(std::size_t, std::size_t);
void* __libc_valloc(std::size_t);
void* __libc_pvalloc(std::size_t);

// Names and signatures are those of the C library, including noexcept.
void* malloc(std::size_t size) noexcept {
  count_heap();
  return __libc_malloc(size);
}
void free(void* p) noexcept {
  if (p != nullptr) count_heap();  // freeing a null pointer, as Eigen does, does not touch the heap
  __libc_free(p);
}
void* calloc(std::size_t n, std::size_t size) noexcept {
  count_heap();
  return __libc_calloc(n, size);
}
void* realloc(void* p, std::size_t size) noexcept {
  count_heap();
  return __libc_realloc(p, size);
}
void* memalign(std::size_t alignment, std::size_t size) noexcept {
  count_heap();
  return __libc_memalign(alignment, size);
}
void* aligned_alloc(std::size_t alignment, std::size_t size) noexcept {
  count_heap();
  return __libc_memalign(alignment, size);
}
int posix_memalign(void** p, std::size_t alignment, std::size_t size) noexcept {
  count_heap();
  *p = __libc_memalign(alignment, size);
  return *p == nullptr ? ENOMEM : 0;
}
void* valloc(std::size_t size) noexcept {
  count_heap();
  return __libc_valloc(size);
}
void* pvalloc(std::size_t size) noexcept {
  count_heap();
  return __libc_pvalloc(size);
}

#define MULTIPANDA_COUNT_LOCK(result, name, parameters, arguments, specifier) \
  result name parameters specifier {                                          \
    count_lock();                                                             \
    static auto* const next = real<result parameters>(#name);                 \
    return next arguments;                                                    \
  }

MULTIPANDA_COUNT_LOCK(int, pthread_mutex_lock, (pthread_mutex_t * m), (m), noexcept)
MULTIPANDA_COUNT_LOCK(int, pthread_mutex_trylock, (pthread_mutex_t * m), (m), noexcept)
MULTIPANDA_COUNT_LOCK(int, pthread_mutex_timedlock, (pthread_mutex_t * m, const timespec* t), (m, t),
                      noexcept)
MULTIPANDA_COUNT_LOCK(int, pthread_rwlock_rdlock, (pthread_rwlock_t * l), (l), noexcept)
MULTIPANDA_COUNT_LOCK(int, pthread_rwlock_wrlock, (pthread_rwlock_t * l), (l), noexcept)
MULTIPANDA_COUNT_LOCK(int, pthread_rwlock_tryrdlock, (pthread_rwlock_t * l), (l), noexcept)
MULTIPANDA_COUNT_LOCK(int, pthread_rwlock_trywrlock, (pthread_rwlock_t * l), (l), noexcept)
MULTIPANDA_COUNT_LOCK(int, pthread_spin_lock, (pthread_spinlock_t * l), (l), noexcept)
MULTIPANDA_COUNT_LOCK(int, pthread_cond_wait, (pthread_cond_t * c, pthread_mutex_t* m), (c, m), )
MULTIPANDA_COUNT_LOCK(int, pthread_cond_timedwait,
                      (pthread_cond_t * c, pthread_mutex_t* m, const timespec* t), (c, m, t), )
MULTIPANDA_COUNT_LOCK(int, pthread_cond_clockwait,
                      (pthread_cond_t * c, pthread_mutex_t* m, clockid_t k, const timespec* t),
                      (c, m, k, t), )
MULTIPANDA_COUNT_LOCK(int, sem_wait, (sem_t * s), (s), )
MULTIPANDA_COUNT_LOCK(int, sem_trywait, (sem_t * s), (s), noexcept)
MULTIPANDA_COUNT_LOCK(int, sem_timedwait, (sem_t * s, const timespec* t), (s, t), )

// std::atomic::wait and std::counting_semaphore enter the kernel here.
long syscall(long number, ...) noexcept {
  if (number == SYS_futex) count_lock();
  va_list list;
  va_start(list, number);
  long a[6];
  for (long& v : a) v = va_arg(list, long);
  va_end(list);
  static auto* const next = real<long(long, ...)>("syscall");
  return next(number, a[0], a[1], a[2], a[3], a[4], a[5]);
}

}  // extern "C"

namespace {

// Resolves every counted function before main, so that the first call in a loop does not invoke the linker.
struct Primer {
  Primer() {
    pthread_mutex_t m = PTHREAD_MUTEX_INITIALIZER;
    pthread_mutex_lock(&m);
    pthread_mutex_unlock(&m);
    pthread_mutex_trylock(&m);
    pthread_mutex_unlock(&m);
    const timespec past{};
    pthread_mutex_timedlock(&m, &past);
    pthread_cond_t c = PTHREAD_COND_INITIALIZER;
    pthread_cond_timedwait(&c, &m, &past);
    pthread_cond_clockwait(&c, &m, CLOCK_MONOTONIC, &past);
    pthread_mutex_unlock(&m);
    pthread_rwlock_t l = PTHREAD_RWLOCK_INITIALIZER;
    pthread_rwlock_rdlock(&l);
    pthread_rwlock_unlock(&l);
    pthread_rwlock_wrlock(&l);
    pthread_rwlock_unlock(&l);
    pthread_rwlock_tryrdlock(&l);
    pthread_rwlock_unlock(&l);
    pthread_rwlock_trywrlock(&l);
    pthread_rwlock_unlock(&l);
    pthread_spinlock_t spin;
    pthread_spin_init(&spin, PTHREAD_PROCESS_PRIVATE);
    pthread_spin_lock(&spin);
    pthread_spin_unlock(&spin);
    sem_t s;
    sem_init(&s, 0, 2);
    sem_wait(&s);
    sem_trywait(&s);
    sem_timedwait(&s, &past);
    syscall(SYS_getpid);
  }
} primer;

}  // namespace

#endif

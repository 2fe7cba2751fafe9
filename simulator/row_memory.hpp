// Memory of recorded rows. A kernel takes as long to hand out small pages as the engine to fill them. So a thread's next trace
// reuses the memory of a dropped one of the same size, and a long trace has large pages. Linux only: in WebAssembly threads do not
// end, so nothing would free the kept memory.
#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdlib>
#include <new>
#include <vector>

#ifdef __linux__
#include <sys/mman.h>
#endif

namespace cogless {

#ifdef __linux__

class RowMemory {
public:
    static void* take(std::size_t bytes) {
        Free& free = of_this_thread();
        Block* const end = free.block + free.count;
        Block* const same = std::find_if(free.block, end, [bytes](const Block& b) { return b.bytes == bytes; });
        if (same == end) return allocated(bytes);
        void* const at = same->at;
        *same = free.block[--free.count];
        return at;
    }

    static void give_back(void* at, std::size_t bytes) {
        Free& free = of_this_thread();
        if (bytes < smallest || bytes >= large_page || free.count == most_blocks) {
            std::free(at);
        } else {
            free.block[free.count++] = {at, bytes};
        }
    }

private:
    static constexpr std::size_t smallest = std::size_t{1} << 16U, large_page = std::size_t{1} << 21U;  // bytes
    static constexpr std::size_t most_blocks = 16;  // enough for the traces of two groups of lanes

    struct Block {
        void* at;
        std::size_t bytes;
    };
    struct Free {
        Block block[most_blocks]{};
        std::size_t count = 0;

        ~Free() {
            while (count > 0) std::free(block[--count].at);
        }
    };

    static void* allocated(std::size_t bytes) {
        const std::size_t whole = bytes / large_page * large_page;
        void* const at = whole == 0 ? std::malloc(bytes)
                                    : std::aligned_alloc(large_page, whole + (bytes > whole ? large_page : 0));
        if (at == nullptr) throw std::bad_alloc();
        if (whole > 0) madvise(at, whole, MADV_HUGEPAGE);  // only a request
        return at;
    }

    static Free& of_this_thread() {
        thread_local Free free;
        return free;
    }
};

#else

struct RowMemory {
    static void* take(std::size_t bytes) { return ::operator new(bytes); }
    static void give_back(void* at, std::size_t) { ::operator delete(at); }
};

#endif

// Allocates numbers without setting them to zero.
template <class T>
struct RowAllocator {
    using value_type = T;

    T* allocate(std::size_t count) { return static_cast<T*>(RowMemory::take(count * sizeof(T))); }
    void deallocate(T* at, std::size_t count) { RowMemory::give_back(at, count * sizeof(T)); }
    void construct(T* at) noexcept { ::new (at) T; }
    bool operator==(const RowAllocator&) const = default;
};

using Rows = std::vector<double, RowAllocator<double>>;

}  // namespace cogless

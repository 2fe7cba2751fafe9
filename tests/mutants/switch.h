/* Included by a file of C or C++ with mutants in it, of which the environment's COGLESS_MUTANT chooses one, 0 none.
 * Marked functions note that they run in the page COGLESS_HITS, if there is one; mutants.page is the same for Python. */
#ifndef COGLESS_MUTANTS_SWITCH_H
#define COGLESS_MUTANTS_SWITCH_H

#if !defined(__linux__)
#error "mutants are chosen at run time on a host only"
#elif defined(static) /* as control_library.py reads headers, for what they declare */
extern int cogless_mutant;
extern unsigned char *cogless_hits;
#else

#include <fcntl.h>
#include <stdlib.h>
#include <sys/mman.h>

#define COGLESS_ONCE __attribute__((weak, visibility("hidden")))
COGLESS_ONCE int cogless_mutant;
COGLESS_ONCE unsigned char cogless_unread[32768];
COGLESS_ONCE unsigned char *cogless_hits = cogless_unread;

__attribute__((constructor)) static void cogless_choose_mutant(void)
{
    const char *number = getenv("COGLESS_MUTANT"), *page = getenv("COGLESS_HITS");
    if (number) cogless_mutant = atoi(number);
    if (!page || cogless_hits != cogless_unread) return;
    const int file = open(page, O_RDWR);
    void *shared = file < 0 ? MAP_FAILED : mmap(0, 32768, PROT_READ | PROT_WRITE, MAP_SHARED, file, 0);
    if (shared != MAP_FAILED) cogless_hits = (unsigned char *)shared;
}

#endif
#endif

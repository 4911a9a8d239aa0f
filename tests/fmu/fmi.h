/* The part of the C interfaces of FMI 2.0 (chapter 2.1, 4.2) and FMI 3.0 (2.2, 4.2) that our test FMUs implement,
 * written from the standards' texts. FMI is 2 or 3, set by the compiler's command line. */
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

typedef unsigned int Reference;
typedef void *Instance;
typedef enum { Ok, Warning, Discard, Error, Fatal } Status;

#if FMI == 2
typedef int Boolean;
typedef void (*Logger)(void *, const char *, int, const char *, const char *, ...);
typedef struct {
    Logger logger;
    void *(*allocate)(size_t, size_t);
    void (*release)(void *);
    void (*step_finished)(void *, int);
    void *environment;
} Callbacks;
#else
typedef bool Boolean;
typedef void (*Logger)(void *, int, const char *, const char *);
#endif

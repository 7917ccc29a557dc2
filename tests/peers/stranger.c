/* A middleware as others may be, before the real one (LD_PRELOAD). $STRANGER says how it differs:
 * "lies", it says of everything that it is acknowledged, as rmw_zenoh does; "unbounded", it knows
 * no profile of the bridge, so that its histories are longer than the probe fills. */
#define _GNU_SOURCE
#include <dlfcn.h>
#include <stdint.h>
#include <string.h>

extern char **environ;

typedef struct {
    uint64_t seconds, nanoseconds;
} rmw_time_t;

static char *in_environment(const char *name) {
    size_t length = strlen(name);
    for (char **at = environ; at && *at; at++)
        if (strncmp(*at, name, length) == 0 && (*at)[length] == '=')
            return *at + length + 1;
    return NULL;
}

static int is(const char *what) {
    const char *said = in_environment("STRANGER");
    return said && strstr(said, what);
}

char *getenv(const char *name) {
    if (is("unbounded") && strcmp(name, "FASTDDS_DEFAULT_PROFILES_FILE") == 0)
        return NULL;
    return in_environment(name);
}

const char *rmw_get_implementation_identifier(void) { return "rmw_stranger"; }

int rmw_publisher_wait_for_all_acked(const void *publisher, rmw_time_t timeout) {
    static int (*real)(const void *, rmw_time_t);
    if (is("lies"))
        return 0;
    if (!real)
        real = dlsym(dlopen("librmw_fastrtps_cpp.so", RTLD_LAZY | RTLD_NOLOAD),
                     "rmw_publisher_wait_for_all_acked");
    return real(publisher, timeout);
}

/* A process that hears nothing about types over UDP (LD_PRELOAD): neither what others ask it nor
 * what they answer. What the TypeLookup service of DDS sends is made something that is not RTPS.
 *
 * Fast DDS receives over UDP by recvfrom or recvmsg; FASTDDS_BUILTIN_TRANSPORTS=UDPv4 turns its
 * shared memory off.
 */
#define _GNU_SOURCE
#include <dlfcn.h>
#include <string.h>
#include <sys/socket.h>
#include <sys/uio.h>

static const char asks[] = {0, 3, 0, (char)0xc3}; /* DDS-XTypes 1.3, 7.6.3.3.3 */
static const char answers[] = {0, 3, 1, (char)0xc3};

static void pass_over(char *bytes, ssize_t length) {
    if (length < 4 || memcmp(bytes, "RTPS", 4) != 0)
        return;
    if (memmem(bytes, length, asks, sizeof asks) || memmem(bytes, length, answers, sizeof answers))
        memset(bytes, 0, length);
}

ssize_t recvfrom(int fd, void *buffer, size_t size, int flags, struct sockaddr *from,
                 socklen_t *from_size) {
    static ssize_t (*real)(int, void *, size_t, int, struct sockaddr *, socklen_t *);
    if (!real)
        real = dlsym(RTLD_NEXT, "recvfrom");
    ssize_t length = real(fd, buffer, size, flags, from, from_size);
    pass_over(buffer, length);
    return length;
}

ssize_t recvmsg(int fd, struct msghdr *message, int flags) {
    static ssize_t (*real)(int, struct msghdr *, int);
    if (!real)
        real = dlsym(RTLD_NEXT, "recvmsg");
    ssize_t length = real(fd, message, flags);
    if (length > 0 && message->msg_iovlen == 1)
        pass_over(message->msg_iov[0].iov_base, length);
    return length;
}

/* Stands in for the kernel's spidev driver, for tests on a host without an SPI bus.
 *
 * Preloaded into a process, it answers open() of /dev/spidev* and the SPI ioctls, and passes
 * each transfer's bytes over the Unix socket named by SPI_SHIM_SOCKET to emulated boards:
 *
 *   on open   path, zero-padded to 32 bytes    ->  int32: 0 or an errno
 *   transfer  uint32 mode, speed, length, bytes ->  int32: number of bytes or -errno, bytes
 *
 * If the other side has gone, a transfer fails as the driver does after its device was removed.
 */
#define _GNU_SOURCE
#include <dlfcn.h>
#include <errno.h>
#include <fcntl.h>
#include <linux/spi/spidev.h>
#include <stdarg.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>
#include <sys/ioctl.h>
#include <sys/socket.h>
#include <sys/un.h>
#include <unistd.h>

#define PREFIX "/dev/spidev"
#define FILES 1024
#define LENGTH_MAX 4096

struct file {
    int open;
    uint32_t mode, speed;
    uint8_t bits;
};

static struct file files[FILES];

static int fail(int error) {
    errno = error;
    return -1;
}

/* A transfer of the kernel's driver is not interrupted by a signal, so neither is this one. */
static int send_all(int fd, const void *data, size_t size) {
    ssize_t sent;
    for (size_t done = 0; done < size; done += sent > 0 ? (size_t)sent : 0) {
        sent = send(fd, (const char *)data + done, size - done, MSG_NOSIGNAL);
        if (sent < 0 && errno != EINTR)
            return -1;
    }
    return 0;
}

static int receive_all(int fd, void *data, size_t size) {
    ssize_t received;
    for (size_t done = 0; done < size; done += received > 0 ? (size_t)received : 0) {
        received = recv(fd, (char *)data + done, size - done, 0);
        if (received == 0 || (received < 0 && errno != EINTR))
            return -1;
    }
    return 0;
}

static int open_device(const char *path) {
    const char *socket_path = getenv("SPI_SHIM_SOCKET");
    struct sockaddr_un address = {.sun_family = AF_UNIX};
    char name[32] = {0};
    int32_t error = ENOENT;
    if (!socket_path)
        return fail(ENOENT);
    int fd = socket(AF_UNIX, SOCK_STREAM, 0);
    strncpy(address.sun_path, socket_path, sizeof address.sun_path - 1);
    strncpy(name, path, sizeof name - 1);
    if (fd < 0 || fd >= FILES || connect(fd, (struct sockaddr *)&address, sizeof address) ||
        send_all(fd, name, sizeof name) || receive_all(fd, &error, sizeof error) || error) {
        if (fd >= 0)
            close(fd);
        return fail(error);
    }
    files[fd] = (struct file){.open = 1, .speed = 500000, .bits = 8};
    return fd;
}

static int transfer(int fd, const struct spi_ioc_transfer *message) {
    uint32_t header[3] = {files[fd].mode, message->speed_hz ? message->speed_hz : files[fd].speed,
                          message->len};
    int32_t count;
    uint8_t answer[LENGTH_MAX];
    if (message->len > LENGTH_MAX)
        return fail(EMSGSIZE);
    if (send_all(fd, header, sizeof header) ||
        send_all(fd, (const void *)(uintptr_t)message->tx_buf, message->len) ||
        receive_all(fd, &count, sizeof count))
        return fail(ESHUTDOWN);
    if (count < 0)
        return fail(-count);
    if ((uint32_t)count > message->len || receive_all(fd, answer, count))
        return fail(ESHUTDOWN);
    if (message->rx_buf)
        memcpy((void *)(uintptr_t)message->rx_buf, answer, count);
    return count;
}

static int control(int fd, unsigned long request, void *argument) {
    struct file *file = &files[fd];
    if (_IOC_TYPE(request) != SPI_IOC_MAGIC)
        return fail(ENOTTY);
    switch (request) {
    case SPI_IOC_RD_MODE:
        *(uint8_t *)argument = file->mode;
        return 0;
    case SPI_IOC_WR_MODE:
        file->mode = *(uint8_t *)argument;
        return 0;
    case SPI_IOC_RD_MODE32:
        *(uint32_t *)argument = file->mode;
        return 0;
    case SPI_IOC_WR_MODE32:
        file->mode = *(uint32_t *)argument;
        return 0;
    case SPI_IOC_RD_BITS_PER_WORD:
        *(uint8_t *)argument = file->bits;
        return 0;
    case SPI_IOC_WR_BITS_PER_WORD:
        file->bits = *(uint8_t *)argument;
        return 0;
    case SPI_IOC_RD_MAX_SPEED_HZ:
        *(uint32_t *)argument = file->speed;
        return 0;
    case SPI_IOC_WR_MAX_SPEED_HZ:
        file->speed = *(uint32_t *)argument;
        return 0;
    case SPI_IOC_MESSAGE(1):
        return transfer(fd, argument);
    default:
        return fail(EINVAL);
    }
}

static int open_any(const char *symbol, const char *path, int flags, mode_t mode) {
    int (*real)(const char *, int, ...) = (int (*)(const char *, int, ...))dlsym(RTLD_NEXT, symbol);
    return strncmp(path, PREFIX, strlen(PREFIX)) ? real(path, flags, mode) : open_device(path);
}

static mode_t mode_of(int flags, va_list arguments) {
    int creates = (flags & O_CREAT) || (flags & O_TMPFILE) == O_TMPFILE;
    return creates ? va_arg(arguments, mode_t) : 0;
}

int open(const char *path, int flags, ...) {
    va_list arguments;
    va_start(arguments, flags);
    mode_t mode = mode_of(flags, arguments);
    va_end(arguments);
    return open_any("open", path, flags, mode);
}

int open64(const char *path, int flags, ...) {
    va_list arguments;
    va_start(arguments, flags);
    mode_t mode = mode_of(flags, arguments);
    va_end(arguments);
    return open_any("open64", path, flags, mode);
}

int ioctl(int fd, unsigned long request, ...) {
    static int (*real)(int, unsigned long, ...);
    va_list arguments;
    va_start(arguments, request);
    void *argument = va_arg(arguments, void *);
    va_end(arguments);
    if (fd >= 0 && fd < FILES && files[fd].open)
        return control(fd, request, argument);
    if (!real)
        real = (int (*)(int, unsigned long, ...))dlsym(RTLD_NEXT, "ioctl");
    return real(fd, request, argument);
}

int close(int fd) {
    static int (*real)(int);
    if (!real)
        real = (int (*)(int))dlsym(RTLD_NEXT, "close");
    if (fd >= 0 && fd < FILES)
        files[fd].open = 0;
    return real(fd);
}

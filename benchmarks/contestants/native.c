/* The two loops of the contestant `native`: rcl and librdkafka, and nothing else.

What is called is declared here, as it is in rcl (Humble to Rolling) and in librdkafka 2, so that
neither's headers have to be installed. `native.py` compiles and calls it. */

#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>
#include <sys/types.h>
#include <time.h>

#define BATCH 500
#define ROOM 65536
#define NAP_NS 500000
#define FLUSH_MS 1000
#define TEXT_AT 8 /* of a std_msgs/msg/String: behind the header and the length */

enum { PRODUCER, CONSUMER };
enum { COPY = 2, ANY_PARTITION = -1 };

typedef struct { void *functions[4], *state; } allocator_t;
typedef struct { uint8_t *buffer; size_t length, capacity; allocator_t allocator; } bytes_t;
typedef struct {
    int error;
    void *topic;
    int32_t partition;
    void *value;
    size_t length;
    void *key;
    size_t key_length;
    int64_t offset;
    void *own;
} record_t;

allocator_t rcutils_get_default_allocator(void);
int rcutils_uint8_array_init(bytes_t *, size_t, const allocator_t *);
void rcutils_reset_error(void);
int rcl_take_serialized_message(const void *, bytes_t *, void *, void *);
int rcl_publish_serialized_message(const void *, const bytes_t *, void *);

void *rd_kafka_conf_new(void);
int rd_kafka_conf_set(void *, const char *, const char *, char *, size_t);
void *rd_kafka_new(int, void *, char *, size_t);
void *rd_kafka_topic_new(void *, const char *, void *);
int rd_kafka_produce(void *, int32_t, int, void *, size_t, const void *, size_t, void *);
int rd_kafka_poll(void *, int);
int rd_kafka_flush(void *, int);
int rd_kafka_poll_set_consumer(void *);
void *rd_kafka_topic_partition_list_new(int);
void *rd_kafka_topic_partition_list_add(void *, const char *, int32_t);
int rd_kafka_subscribe(void *, void *);
void *rd_kafka_queue_get_consumer(void *);
ssize_t rd_kafka_consume_batch_queue(void *, int, record_t **, size_t);
void rd_kafka_message_destroy(record_t *);

static void nap(void) {
    struct timespec time = {0, NAP_NS};
    nanosleep(&time, NULL);
}

static void make_room(bytes_t *bytes) {
    allocator_t memory = rcutils_get_default_allocator();
    memset(bytes, 0, sizeof *bytes);
    if (rcutils_uint8_array_init(bytes, ROOM, &memory)) abort();
}

/* `properties` are names and values in turn, up to a NULL. */
static void *client(int kind, const char **properties) {
    char error[512];
    void *conf = rd_kafka_conf_new();
    for (; *properties; properties += 2)
        if (rd_kafka_conf_set(conf, properties[0], properties[1], error, sizeof error)) abort();
    void *made = rd_kafka_new(kind, conf, error, sizeof error);
    if (!made) abort();
    return made;
}

void ros_to_kafka(const void *subscription, const char *topic, const char **properties,
                  volatile int *ends) {
    bytes_t cdr;
    uint32_t length;
    void *producer = client(PRODUCER, properties);
    void *to = rd_kafka_topic_new(producer, topic, NULL);
    make_room(&cdr);
    while (!*ends) {
        int taken = 0;
        while (taken < BATCH && !rcl_take_serialized_message(subscription, &cdr, NULL, NULL)) {
            memcpy(&length, cdr.buffer + 4, sizeof length);
            if (!length || TEXT_AT + (size_t)length > cdr.length) abort(); /* it is no String */
            while (rd_kafka_produce(to, ANY_PARTITION, COPY, cdr.buffer + TEXT_AT, length - 1, NULL,
                                    0, NULL) && !*ends)
                rd_kafka_poll(producer, 10); /* its queue is full */
            taken++;
        }
        rd_kafka_poll(producer, 0);
        if (!taken) nap();
    }
    rd_kafka_flush(producer, FLUSH_MS);
}

void kafka_to_ros(const void *publisher, const char *topic, const char **properties,
                  volatile int *ends) {
    bytes_t cdr;
    record_t *records[BATCH];
    void *consumer = client(CONSUMER, properties);
    void *topics = rd_kafka_topic_partition_list_new(1);
    rd_kafka_poll_set_consumer(consumer);
    rd_kafka_topic_partition_list_add(topics, topic, ANY_PARTITION);
    if (rd_kafka_subscribe(consumer, topics)) abort();
    void *queue = rd_kafka_queue_get_consumer(consumer);
    make_room(&cdr);
    while (!*ends) {
        ssize_t count = rd_kafka_consume_batch_queue(queue, 50, records, BATCH);
        for (ssize_t i = 0; i < count; i++) {
            record_t *record = records[i];
            if (!record->error && record->length + TEXT_AT + 1 <= ROOM) {
                uint32_t length = record->length + 1;
                memcpy(cdr.buffer, "\0\1\0\0", 4);
                memcpy(cdr.buffer + 4, &length, sizeof length);
                memcpy(cdr.buffer + TEXT_AT, record->value, record->length);
                cdr.buffer[TEXT_AT + record->length] = 0;
                cdr.length = TEXT_AT + length;
                while (!*ends && rcl_publish_serialized_message(publisher, &cdr, NULL)) {
                    rcutils_reset_error(); /* the history is full */
                    nap();
                }
            }
            rd_kafka_message_destroy(record);
        }
    }
}

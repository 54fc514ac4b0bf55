/*
 * libdescry_recognise as a program in C meets it; tests/python/c_library.py builds and runs this.
 *
 *     check answers ARTEFACT LIST MOST THREADS   answers to all clouds, one a line, the same on every thread
 *     check signatures ARTEFACT LIST OUT         lengths of the channels; signatures of all clouds as floats in OUT
 *     check misuse ARTEFACT LIST BROKEN          what must be refused; BROKEN has damaged artefacts
 *     check large ARTEFACT                       the largest clouds
 *     check memory ARTEFACT LIST COUNT           memory that COUNT clouds leave behind, in KiB
 *
 * LIST has a line a cloud: files of coordinates and of colours, and x, y, z of the camera.
 */
#define _POSIX_C_SOURCE 200809L
#include <descry_recognise.h>

#include <float.h>
#include <math.h>
#include <pthread.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#define MOST_POINTS 22369621u

#define CHECK(condition) check((condition), #condition, __LINE__)
#define REFUSED(call, status, what) refused((call), (status), (what), #call, __LINE__)

typedef struct {
    float *xyz;
    unsigned char *rgb;
    size_t points;
    float viewpoint[3];
} cloud;

typedef struct {
    cloud *clouds;
    size_t count;
} clouds;

static void check(bool condition, const char *text, int line)
{
    if (!condition) {
        fprintf(stderr, "line %d: %s: %s, %s\n", line, text, descry_error_what(), descry_error_advice());
        exit(1);
    }
}

static void refused(descry_status got, descry_status expected, const char *what, const char *text, int line)
{
    bool is_said = strstr(descry_error_what(), what) != NULL && *descry_error_advice() != '\0';
    if (got != expected || !is_said) {
        fprintf(stderr, "line %d: %s: %s instead of %s with \"%s\": %s\n%s\n", line, text, descry_status_name(got),
                descry_status_name(expected), what, descry_error_what(), descry_error_advice());
        exit(1);
    }
}

static void *allocated(size_t bytes)
{
    void *memory = malloc(bytes ? bytes : 1);
    CHECK(memory != NULL);
    return memory;
}

static void *read_file(const char *path, size_t *size)
{
    FILE *file = fopen(path, "rb");
    void *bytes;
    CHECK(file != NULL && fseek(file, 0, SEEK_END) == 0);
    *size = (size_t)ftell(file);
    bytes = allocated(*size);
    rewind(file);
    CHECK(fread(bytes, 1, *size, file) == *size);
    fclose(file);
    return bytes;
}

static clouds read_list(const char *path)
{
    clouds list = {NULL, 0};
    char xyz[4096], rgb[4096];
    cloud one;
    FILE *file = fopen(path, "r");
    CHECK(file != NULL);
    while (fscanf(file, "%4095s %4095s %f %f %f", xyz, rgb, &one.viewpoint[0], &one.viewpoint[1],
                  &one.viewpoint[2]) == 5) {
        size_t bytes, colours;
        one.xyz = (float *)read_file(xyz, &bytes);
        one.rgb = (unsigned char *)read_file(rgb, &colours);
        one.points = bytes / 12;
        CHECK(bytes == 12 * one.points && colours == 3 * one.points);
        list.clouds = (cloud *)realloc(list.clouds, (list.count + 1) * sizeof(cloud));
        CHECK(list.clouds != NULL);
        list.clouds[list.count++] = one;
    }
    CHECK(feof(file) && list.count > 0);
    fclose(file);
    return list;
}

static void free_list(clouds list)
{
    size_t i;
    for (i = 0; i < list.count; i++) {
        free(list.clouds[i].xyz);
        free(list.clouds[i].rgb);
    }
    free(list.clouds);
}

static descry_recogniser *opened(const char *artefact)
{
    descry_recogniser *recogniser;
    CHECK(descry_recogniser_open(artefact, &recogniser) == DESCRY_OK && recogniser != NULL);
    return recogniser;
}

static descry_answer *recognised(const descry_recogniser *recogniser, const cloud *one, size_t most)
{
    descry_answer *answer;
    CHECK(descry_recogniser_recognise(recogniser, one->xyz, one->rgb, one->points, one->viewpoint, most, &answer) ==
          DESCRY_OK);
    return answer;
}

/* A line: unknown, probability, and each object with tabs between its parts. Every digit of the numbers is there. */
static void print_answer(FILE *to, const descry_answer *answer)
{
    size_t i;
    fprintf(to, "%d\t%.17g", answer->unknown, answer->known_probability);
    for (i = 0; i < answer->count; i++) {
        const descry_named *one = &answer->ranking[i];
        fprintf(to, "\t%s\t%s\t%s\t%.17g", one->instance, one->category, one->cloud, one->distance);
    }
    fputc('\n', to);
}

typedef struct {
    const descry_recogniser *recogniser;
    clouds list;
    size_t most;
    char *text;
    size_t length;
} work;

static void *answer_all(void *argument)
{
    work *mine = (work *)argument;
    FILE *to = open_memstream(&mine->text, &mine->length);
    size_t i;
    CHECK(to != NULL);
    for (i = 0; i < mine->list.count; i++) {
        descry_answer *answer = recognised(mine->recogniser, &mine->list.clouds[i], mine->most);
        print_answer(to, answer);
        descry_answer_free(answer);
    }
    fclose(to);
    return NULL;
}

static void answers(const char *artefact, clouds list, size_t most, size_t threads)
{
    descry_recogniser *recogniser = opened(artefact);
    pthread_attr_t small;
    pthread_t *ids = (pthread_t *)allocated(threads * sizeof *ids);
    work *works = (work *)allocated(threads * sizeof *works);
    size_t i;
    CHECK(pthread_attr_init(&small) == 0 && pthread_attr_setstacksize(&small, 256 << 10) == 0);
    for (i = 0; i < threads; i++) {
        work mine = {NULL, {NULL, 0}, 0, NULL, 0};
        mine.recogniser = recogniser;
        mine.list = list;
        mine.most = most;
        works[i] = mine;
        CHECK(pthread_create(&ids[i], &small, answer_all, &works[i]) == 0);
    }
    for (i = 0; i < threads; i++)
        CHECK(pthread_join(ids[i], NULL) == 0);
    pthread_attr_destroy(&small);
    for (i = 1; i < threads; i++)
        CHECK(works[i].length == works[0].length && memcmp(works[i].text, works[0].text, works[0].length) == 0);
    CHECK(fwrite(works[0].text, 1, works[0].length, stdout) == works[0].length);
    for (i = 0; i < threads; i++)
        free(works[i].text);
    free(works);
    free(ids);
    descry_recogniser_free(recogniser);
}

static void signatures(const char *artefact, clouds list, const char *out)
{
    descry_recogniser *recogniser = opened(artefact);
    descry_channel channels[8];
    size_t count, needed, values = 0, i;
    float *signature;
    FILE *to = fopen(out, "wb");
    CHECK(to != NULL);
    CHECK(descry_recogniser_channels(recogniser, channels, 8, &count) == DESCRY_OK);
    for (i = 0; i < count; i++) {
        printf("%lu %lu\n", (unsigned long)channels[i].centroid, (unsigned long)channels[i].deviation);
        values += channels[i].centroid + channels[i].deviation;
    }
    signature = (float *)allocated(values * sizeof *signature);
    for (i = 0; i < list.count; i++) {
        const cloud *one = &list.clouds[i];
        CHECK(descry_recogniser_describe(recogniser, one->xyz, one->rgb, one->points, one->viewpoint, signature,
                                         values, &needed) == DESCRY_OK &&
              needed == values);
        CHECK(fwrite(signature, sizeof *signature, values, to) == values);
    }
    free(signature);
    fclose(to);
    descry_recogniser_free(recogniser);
}

static void *fail_elsewhere(void *recogniser)
{
    descry_answer *answer;
    CHECK(*descry_error_what() == '\0' && *descry_error_advice() == '\0');
    REFUSED(descry_recogniser_recognise((descry_recogniser *)recogniser, NULL, NULL, 0, NULL, 0, &answer),
            DESCRY_ERROR_ARGUMENT, "most: must be at least 1");
    return NULL;
}

static void misuse_of_paths(const char *artefact, const char *broken)
{
    /* Stays there where nothing is stored. */
    descry_recogniser *const garbage = (descry_recogniser *)broken;
    descry_recogniser *recogniser = garbage;
    char *path = (char *)allocated(100001);
    static const struct {
        const char *name;
        descry_status status;
        const char *what;
    } cases[] = {
        {"absent", DESCRY_ERROR_READ, "absent/descriptor.toml: cannot be read"},
        {"file", DESCRY_ERROR_READ, "file/descriptor.toml: cannot be read"},
        {"empty", DESCRY_ERROR_READ, "empty/descriptor.toml: cannot be read"},
        {"settings", DESCRY_ERROR_ARTEFACT, "settings/descriptor.toml: "},
        {"database", DESCRY_ERROR_ARTEFACT, "database/database.parquet: "},
        {"no-database", DESCRY_ERROR_READ, "no-database/database.parquet: cannot read"},
        {"version", DESCRY_ERROR_VERSION, "version/descriptor.toml: "},
        {"n\xff\xfe", DESCRY_ERROR_READ, "cannot be read"},
    };
    size_t i;

    REFUSED(descry_recogniser_open(NULL, &recogniser), DESCRY_ERROR_ARGUMENT, "path: must point to something, got NULL");
    CHECK(recogniser == NULL);
    REFUSED(descry_recogniser_open(artefact, NULL), DESCRY_ERROR_ARGUMENT, "recogniser: must point to something");
    REFUSED(descry_recogniser_open(artefact, (descry_recogniser **)((char *)&recogniser + 1)), DESCRY_ERROR_ARGUMENT,
            "recogniser: must be aligned to");
    CHECK(setenv("DESCRY_VECTORS", "v9", 1) == 0);
    REFUSED(descry_recogniser_open(artefact, &recogniser), DESCRY_ERROR_ARGUMENT, "DESCRY_VECTORS: ");
    CHECK(unsetenv("DESCRY_VECTORS") == 0);
    REFUSED(descry_recogniser_open("", &recogniser), DESCRY_ERROR_ARGUMENT, "path: must name a folder");
    for (i = 0; i < sizeof cases / sizeof *cases; i++) {
        recogniser = garbage;
        snprintf(path, 100001, "%s/%s", broken, cases[i].name);
        REFUSED(descry_recogniser_open(path, &recogniser), cases[i].status, cases[i].what);
        CHECK(recogniser == NULL && strchr(descry_error_what(), '\n') == NULL);
    }
    memset(path, 'a', 100000);
    path[100000] = '\0';
    REFUSED(descry_recogniser_open(path, &recogniser), DESCRY_ERROR_READ, "cannot be read");
    REFUSED(descry_recogniser_open("/dev/zero", &recogniser), DESCRY_ERROR_READ, "cannot be read");
    free(path);

    /* A folder may have any name that the system allows. */
    path = (char *)allocated(strlen(broken) + 16);
    sprintf(path, "%s/\xe4\xff", broken);
    CHECK(descry_recogniser_open(path, &recogniser) == DESCRY_OK);
    descry_recogniser_free(recogniser);
    free(path);
}

static void misuse_of_clouds(const descry_recogniser *recogniser, const cloud *one)
{
    const float *xyz = one->xyz, *viewpoint = one->viewpoint;
    const unsigned char *rgb = one->rgb;
    const size_t points = one->points;
    const descry_recogniser *misaligned = (const descry_recogniser *)((const char *)recogniser + 1);
    const float *odd = (const float *)((const char *)xyz + 1);
    descry_answer *const garbage = (descry_answer *)one->xyz;
    descry_answer *answer = garbage, *sound = recognised(recogniser, one, 3);
    float *copy = (float *)allocated(12 * (points + 2)), nowhere[3] = {0, 0, 0};
    unsigned char *colours = (unsigned char *)allocated(3 * (points + 2) + 1);
    static const float bad[] = {NAN, INFINITY, -INFINITY};
    size_t i, j;

#define ASK(r, xyz, rgb, n, view, most, answer) descry_recogniser_recognise(r, xyz, rgb, n, view, most, answer)
    REFUSED(ASK(NULL, xyz, rgb, points, viewpoint, 1, &answer), DESCRY_ERROR_ARGUMENT, "recogniser: must point to");
    CHECK(answer == NULL);
    REFUSED(ASK(misaligned, xyz, rgb, points, viewpoint, 1, &answer), DESCRY_ERROR_ARGUMENT, "recogniser: must be aligned");
    REFUSED(ASK(recogniser, xyz, rgb, points, viewpoint, 1, NULL), DESCRY_ERROR_ARGUMENT, "answer: must point to");
    REFUSED(ASK(recogniser, xyz, rgb, points, viewpoint, 1, (descry_answer **)((char *)&answer + 1)),
            DESCRY_ERROR_ARGUMENT, "answer: must be aligned");
    REFUSED(ASK(recogniser, xyz, rgb, points, viewpoint, 0, &answer), DESCRY_ERROR_ARGUMENT, "most: must be at least 1");
    REFUSED(ASK(recogniser, NULL, rgb, points, viewpoint, 1, &answer), DESCRY_ERROR_ARGUMENT, "xyz: must point to");
    REFUSED(ASK(recogniser, odd, rgb, 1, viewpoint, 1, &answer), DESCRY_ERROR_ARGUMENT,
            "xyz: must be aligned to 4 bytes, got an address 1 bytes off");
    REFUSED(ASK(recogniser, xyz, rgb, points, odd, 1, &answer), DESCRY_ERROR_ARGUMENT, "viewpoint: must be aligned");
    for (i = 0; i < 3; i++)
        for (j = 0; j < 3; j++) {
            nowhere[i] = bad[j];
            REFUSED(ASK(recogniser, xyz, rgb, points, nowhere, 1, &answer), DESCRY_ERROR_ARGUMENT,
                    "viewpoint: must be finite");
            nowhere[i] = 0;
        }

    /* No memory of this size is looked at. */
    for (i = MOST_POINTS + (size_t)1; i != 0; i = i > SIZE_MAX / 2 ? 0 : 2 * i + 1) {
        REFUSED(ASK(recogniser, xyz, rgb, i, viewpoint, 1, &answer), DESCRY_ERROR_ARGUMENT, "xyz: must hold at most");
        REFUSED(ASK(recogniser, NULL, NULL, i, NULL, 1, &answer), DESCRY_ERROR_ARGUMENT, "xyz: must hold at most");
    }
    REFUSED(ASK(recogniser, xyz, rgb, SIZE_MAX / 12 + 1, NULL, 1, &answer), DESCRY_ERROR_ARGUMENT, "at most");
    REFUSED(ASK(recogniser, xyz, rgb, SIZE_MAX / 3 + 1, NULL, 1, &answer), DESCRY_ERROR_ARGUMENT, "at most");
    REFUSED(ASK(recogniser, NULL, NULL, MOST_POINTS, NULL, 1, &answer), DESCRY_ERROR_ARGUMENT, "xyz: must point to");

    /* Sound arguments, but no object to be seen. */
    REFUSED(ASK(recogniser, NULL, NULL, 0, NULL, 1, &answer), DESCRY_ERROR_CLOUD, "usable points, got 0");
    REFUSED(ASK(recogniser, xyz, rgb, 0, viewpoint, 1, &answer), DESCRY_ERROR_CLOUD, "usable points, got 0");
    REFUSED(ASK(recogniser, xyz, rgb, 9, viewpoint, 1, &answer), DESCRY_ERROR_CLOUD, "usable points, got 9");
    REFUSED(ASK(recogniser, xyz, NULL, points, viewpoint, 1, &answer), DESCRY_ERROR_CLOUD, "colours");
    CHECK(answer == NULL);
    for (j = 0; j < 3; j++) {
        for (i = 0; i < 3 * points; i++)
            copy[i] = bad[j];
        REFUSED(ASK(recogniser, copy, rgb, points, viewpoint, 1, &answer), DESCRY_ERROR_CLOUD, "usable points, got 0");
    }
    for (i = 0; i < 3 * points; i++)
        copy[i] = i % 2 ? FLT_MAX : -FLT_MAX;
    REFUSED(ASK(recogniser, copy, rgb, points, viewpoint, 1, &answer), DESCRY_ERROR_CLOUD, "got ");
    for (i = 0; i < 3 * points; i++)
        copy[i] = FLT_MIN / 1024;
    ASK(recogniser, copy, rgb, points, viewpoint, 1, &answer);
    descry_answer_free(answer);

    /* Points that are not finite are left out; colours may lie at any address. */
    memcpy(copy, xyz, 12 * points);
    memcpy(colours + 1, rgb, 3 * points);
    for (i = 0; i < 6; i++)
        copy[3 * points + i] = i % 3 ? 0 : bad[i / 3];
    CHECK(ASK(recogniser, copy, colours + 1, points + 2, viewpoint, 3, &answer) == DESCRY_OK);
    CHECK(answer->count == sound->count && answer->ranking[2].distance == sound->ranking[2].distance);
    descry_answer_free(answer);

    CHECK(ASK(recogniser, xyz, rgb, points, viewpoint, SIZE_MAX, &answer) == DESCRY_OK);
    CHECK(answer->count > 3 && strcmp(answer->ranking[0].instance, sound->ranking[0].instance) == 0);
    CHECK(answer->ranking[0].distance == sound->ranking[0].distance);
    descry_answer_free(answer);
    descry_answer_free(sound);
    free(colours);
    free(copy);
#undef ASK
}

static void misuse_of_buffers(const descry_recogniser *recogniser, const cloud *one)
{
    descry_channel channels[8];
    size_t needed = 77, count = 0, i;
    float *values;
#define DESCRIBE(values, capacity, needed)                                                                             \
    descry_recogniser_describe(recogniser, one->xyz, one->rgb, one->points, one->viewpoint, values, capacity, needed)
    REFUSED(descry_recogniser_describe(NULL, one->xyz, one->rgb, one->points, NULL, NULL, 0, &needed),
            DESCRY_ERROR_ARGUMENT, "recogniser: must point to");
    CHECK(needed == 0);
    REFUSED(DESCRIBE(NULL, 0, &needed), DESCRY_ERROR_BUFFER, "capacity: must be at least");
    CHECK(needed > 0);
    values = (float *)allocated((needed + 1) * sizeof *values);
    for (i = 0; i <= needed; i++)
        values[i] = -77;
    REFUSED(DESCRIBE(values, needed - 1, NULL), DESCRY_ERROR_BUFFER, "capacity: must be at least");
    REFUSED(DESCRIBE(NULL, needed, NULL), DESCRY_ERROR_ARGUMENT, "values: must point to");
    REFUSED(DESCRIBE((float *)((char *)values + 2), needed, NULL), DESCRY_ERROR_ARGUMENT, "values: must be aligned");
    REFUSED(DESCRIBE(values, needed, (size_t *)((char *)&count + 1)), DESCRY_ERROR_ARGUMENT, "needed: must be aligned");
    REFUSED(descry_recogniser_describe(recogniser, one->xyz, one->rgb, 3, NULL, values, needed, NULL),
            DESCRY_ERROR_CLOUD, "usable points, got 3");
    for (i = 0; i <= needed; i++)
        CHECK(values[i] == -77);
    CHECK(DESCRIBE(values, needed + 1, NULL) == DESCRY_OK && values[needed] == -77);
    for (i = 0; i < needed; i++)
        CHECK(values[i] >= 0);
    free(values);
#undef DESCRIBE
    REFUSED(descry_recogniser_channels(NULL, channels, 8, &count), DESCRY_ERROR_ARGUMENT, "recogniser: must point to");
    REFUSED(descry_recogniser_channels(recogniser, NULL, 0, &count), DESCRY_ERROR_BUFFER, "capacity: must be at least");
    CHECK(count > 0 && count <= 8);
    REFUSED(descry_recogniser_channels(recogniser, NULL, 8, &count), DESCRY_ERROR_ARGUMENT, "channels: must point to");
    CHECK(descry_recogniser_channels(recogniser, channels, count, NULL) == DESCRY_OK);
    for (i = 0; i < count; i++)
        needed -= channels[i].centroid + channels[i].deviation;
    CHECK(needed == 0);
}

static void misuse(const char *artefact, clouds list, const char *broken)
{
    descry_recogniser *recogniser = opened(artefact);
    descry_answer *answer;
    pthread_t other;
    char *said;
    int status;

    CHECK(strcmp(descry_error_what(), "") == 0 && strcmp(descry_error_advice(), "") == 0);
    misuse_of_paths(artefact, broken);
    misuse_of_clouds(recogniser, &list.clouds[0]);
    misuse_of_buffers(recogniser, &list.clouds[0]);
    for (status = -3; status < 12; status++)
        CHECK(strncmp(descry_status_name(status), status < 0 || status > 7 ? "unknown" : "DESCRY_", 7) == 0);

    /* Errors are of their thread, and stay when a call succeeds. */
    REFUSED(descry_recogniser_recognise(recogniser, NULL, NULL, 7, NULL, 1, &answer), DESCRY_ERROR_ARGUMENT, "xyz");
    said = strdup(descry_error_what());
    CHECK(pthread_create(&other, NULL, fail_elsewhere, recogniser) == 0 && pthread_join(other, NULL) == 0);
    answer = recognised(recogniser, &list.clouds[0], 2);
    CHECK(strcmp(said, descry_error_what()) == 0);
    free(said);

    /* An answer outlives its recogniser. */
    descry_recogniser_free(recogniser);
    CHECK(answer->count == 2 && strlen(answer->ranking[1].cloud) > 0 && !answer->unknown);
    descry_answer_free(answer);
    descry_answer_free(NULL);
    descry_recogniser_free(NULL);
}

static void large(const char *artefact)
{
    descry_recogniser *recogniser = opened(artefact);
    descry_answer *answer;
    float *xyz = (float *)allocated(12 * (size_t)MOST_POINTS);
    unsigned char *rgb = (unsigned char *)allocated(3 * (size_t)MOST_POINTS);
    size_t i;
    memset(rgb, 128, 3 * (size_t)MOST_POINTS);
    for (i = 0; i < 3 * (size_t)MOST_POINTS; i++)
        xyz[i] = 0.5f;
    REFUSED(descry_recogniser_recognise(recogniser, xyz, rgb, MOST_POINTS, NULL, 1, &answer), DESCRY_ERROR_CLOUD,
            "pairs of points");
    for (i = 0; i < 3 * (size_t)MOST_POINTS; i++)
        xyz[i] = NAN;
    REFUSED(descry_recogniser_recognise(recogniser, xyz, rgb, MOST_POINTS, NULL, 1, &answer), DESCRY_ERROR_CLOUD,
            "usable points, got 0");
    free(rgb);
    free(xyz);
    descry_recogniser_free(recogniser);
}

static long resident(void)
{
    long pages = 0;
    FILE *file = fopen("/proc/self/statm", "r");
    CHECK(file != NULL && fscanf(file, "%*d %ld", &pages) == 1);
    fclose(file);
    return pages * (sysconf(_SC_PAGESIZE) / 1024);
}

static void some(const descry_recogniser *recogniser, clouds list, size_t count)
{
    descry_answer *answer;
    size_t i;
    for (i = 0; i < count; i++) {
        answer = recognised(recogniser, &list.clouds[i % list.count], 3);
        descry_answer_free(answer);
        /* Failures allocate, too. */
        CHECK(descry_recogniser_recognise(recogniser, NULL, NULL, i % 9, NULL, 1, &answer) != DESCRY_OK);
    }
}

static void memory(const char *artefact, clouds list, size_t count)
{
    descry_recogniser *recogniser = opened(artefact);
    long before;
    int i;
    some(recogniser, list, count / 10);
    before = resident();
    some(recogniser, list, count);
    printf("%ld clouds\n", resident() - before);
    before = resident();
    for (i = 0; i < 100; i++)
        descry_recogniser_free(opened(artefact));
    printf("%ld openings\n", resident() - before);
    descry_recogniser_free(recogniser);
}

int main(int argc, char **argv)
{
    const char *mode = argc > 2 ? argv[1] : "";
    clouds list = {NULL, 0};
    if (strcmp(mode, "large") == 0) {
        large(argv[2]);
        return 0;
    }
    if (argc < 5)
        return 2;
    list = read_list(argv[3]);
    if (strcmp(mode, "answers") == 0 && argc == 6)
        answers(argv[2], list, strtoul(argv[4], NULL, 10), strtoul(argv[5], NULL, 10));
    else if (strcmp(mode, "signatures") == 0)
        signatures(argv[2], list, argv[4]);
    else if (strcmp(mode, "misuse") == 0)
        misuse(argv[2], list, argv[4]);
    else if (strcmp(mode, "memory") == 0)
        memory(argv[2], list, strtoul(argv[4], NULL, 10));
    else
        return 2;
    free_list(list);
    return 0;
}

/*
 * Names the object in a cloud that lies in files of plain numbers.
 *
 *     cc recognise.c $(pkg-config --cflags --libs descry_recognise) -o recognise
 *     ./recognise ARTEFACT cloud.xyz [cloud.rgb]
 *
 * cloud.xyz: x, y, z of each point as 32-bit floats of this machine, in metres.
 * cloud.rgb: red, green, blue of each point as bytes.
 */
#include <descry_recognise.h>

#include <stdio.h>
#include <stdlib.h>

/* All bytes of a file, to be freed; NULL after a message. */
static void *read_file(const char *path, size_t *size)
{
    FILE *file = fopen(path, "rb");
    char *bytes = NULL;
    long length;

    if (file == NULL) {
        perror(path);
        return NULL;
    }
    if (fseek(file, 0, SEEK_END) == 0 && (length = ftell(file)) >= 0 && fseek(file, 0, SEEK_SET) == 0) {
        *size = (size_t)length;
        bytes = (char *)malloc(*size + 1);
        if (bytes != NULL && fread(bytes, 1, *size, file) != *size) {
            free(bytes);
            bytes = NULL;
        }
    }
    fclose(file);
    if (bytes == NULL)
        fprintf(stderr, "%s: cannot be read\n", path);
    return bytes;
}

static void complain(const char *about)
{
    fprintf(stderr, "%s: %s\n%s\n", about, descry_error_what(), descry_error_advice());
}

static int recognise(const descry_recogniser *recogniser, const char *name, const float *xyz,
                     const unsigned char *rgb, size_t points)
{
    descry_answer *answer;
    size_t i;

    if (descry_recogniser_recognise(recogniser, xyz, rgb, points, NULL, 3, &answer) != DESCRY_OK) {
        complain(name);
        return 1;
    }
    if (answer->unknown)
        printf("%s: unknown, most like\n", name);
    for (i = 0; i < answer->count; i++) {
        const descry_named *one = &answer->ranking[i];
        printf("%s: %s (%s), distance %.6f\n", name, one->instance, one->category, one->distance);
    }
    descry_answer_free(answer);
    return 0;
}

/* The signature, for programs that compare clouds by themselves. */
static int describe(const descry_recogniser *recogniser, const char *name, const float *xyz,
                    const unsigned char *rgb, size_t points)
{
    size_t needed;
    float *values;
    descry_status status;

    /* Without room, the call says how much is needed. */
    if (descry_recogniser_describe(recogniser, xyz, rgb, points, NULL, NULL, 0, &needed) != DESCRY_ERROR_BUFFER) {
        complain(name);
        return 1;
    }
    values = (float *)malloc(needed * sizeof *values);
    if (values == NULL)
        return 1;
    status = descry_recogniser_describe(recogniser, xyz, rgb, points, NULL, values, needed, NULL);
    if (status == DESCRY_OK)
        printf("%s: signature of %lu values\n", name, (unsigned long)needed);
    else
        complain(name);
    free(values);
    return status != DESCRY_OK;
}

int main(int argc, char **argv)
{
    descry_recogniser *recogniser = NULL;
    float *xyz = NULL;
    unsigned char *rgb = NULL;
    size_t bytes = 0, colours = 0, points;
    int failed = 1;

    if (argc < 3 || argc > 4) {
        fprintf(stderr, "usage: %s ARTEFACT XYZ [RGB]\n", argv[0]);
        return 2;
    }
    if (descry_recogniser_open(argv[1], &recogniser) != DESCRY_OK) {
        complain(argv[1]);
        return 1;
    }
    xyz = (float *)read_file(argv[2], &bytes);
    if (xyz == NULL)
        goto end;
    points = bytes / (3 * sizeof *xyz);
    if (argc == 4) {
        rgb = (unsigned char *)read_file(argv[3], &colours);
        if (rgb == NULL)
            goto end;
        if (colours != 3 * points) {
            fprintf(stderr, "%s: three bytes for each of %lu points expected\n", argv[3], (unsigned long)points);
            goto end;
        }
    }
    failed = recognise(recogniser, argv[2], xyz, rgb, points) || describe(recogniser, argv[2], xyz, rgb, points);
end:
    free(rgb);
    free(xyz);
    descry_recogniser_free(recogniser);
    return failed;
}

/*
 * The dumps of docs/wire-format.md, for C and C++; WIRE_FORMAT is the page's path.
 *
 * In a dump, 00*4 repeats a byte four times, and # starts a comment.
 */
#ifndef WIRE_FORMAT_H
#define WIRE_FORMAT_H

#include <stddef.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

/* Reads the dump with this name and returns its size. Exits if it is missing or malformed. */
static inline size_t wire_format_read(const char *name, unsigned char *to, size_t capacity) {
    FILE *page = fopen(WIRE_FORMAT, "r");
    char line[1024];
    char start[64];
    size_t size = 0;
    int found = 0;
    snprintf(start, sizeof start, "```hex %s\n", name);
    while (page != NULL && fgets(line, sizeof line, page) != NULL) {
        if (!found) {
            found = strcmp(line, start) == 0;
            continue;
        }
        if (strncmp(line, "```", 3) == 0) {
            fclose(page);
            return size;
        }
        line[strcspn(line, "#\n")] = '\0';
        for (char *at = line + strspn(line, " "); *at != '\0'; at += strspn(at, " ")) {
            char *end = at;
            const unsigned long byte = strtoul(at, &end, 16);
            const unsigned long times = *end == '*' ? strtoul(end + 1, &end, 10) : 1;
            if (end == at || byte > 0xFF || times > capacity - size) abort();
            memset(to + size, (int)byte, times);
            size += times;
            at = end;
        }
    }
    fprintf(stderr, "%s has no dump %s\n", WIRE_FORMAT, name);
    exit(1);
}

#endif

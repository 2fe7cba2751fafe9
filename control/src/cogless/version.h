/* Versions of this library, and of the maps that it stores. */
#ifndef COGLESS_VERSION_H
#define COGLESS_VERSION_H

#define CGL_VERSION 200U /* major * 10000 + minor * 100 + patch: 0.2.0 */

#define CGL_MAP_VERSION 1U /* version of the format in SPEC.md; a load accepts no other one */

#endif

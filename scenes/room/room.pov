// A furnished workshop of 8 x 6 x 3 m: x -4..4, y 0..3 (up), z -3..3. The rig stands near (0, 1.65, -1.75).
// The caller declares Cam_Location, Cam_Right, Cam_Down, Cam_Forward and Depth (see scenes/render.py).
#version 3.7;
global_settings { assumed_gamma 1.0 max_trace_level 2 ambient_light rgb 1 }
#include "macros.inc"

camera { perspective location Cam_Location right 2 * Cam_Right up -2 * Cam_Down direction Cam_Forward }

#if (Depth)
  // Unlit surfaces in white fog: a pixel is 1 - exp(-range / 4 m), whatever the object's own transform is.
  fog { fog_type 1 distance 4 color rgb 1 }
  background { rgb 0 }
#else
  #macro Lamp(P, V) light_source { P rgb V area_light x * 0.9, z * 0.5, 3, 3 adaptive 1 fade_distance 2.5 fade_power 1.5 } #end
  Lamp(<-2.2, 2.78, 0.6>, <1.0, 0.93, 0.82> * 0.9)
  Lamp(<1.9, 2.78, 0.2>, <0.95, 0.97, 1.0> * 0.95)
  light_source { <0.2, 1.9, -2.7> rgb 0.22 shadowless }
  light_source { <0.0, 0.3, 0.5> rgb <0.2, 0.17, 0.14> shadowless }
  light_source { <-3.2, 1.4, -1.6> rgb 0.12 shadowless }
#end

#declare SF = seed(11);
#declare SW = seed(23);
#declare SB = seed(37);
#declare SC = seed(53);
#declare SP = seed(71);
#declare SK = seed(89);

// ---- floor: planks, each with its own grain ----
#declare Z = -3;
#while (Z < 3)
  #declare X = -4 - U(SF, 0, 1.2);
  #while (X < 4)
    #declare L = U(SF, 0.7, 1.9);
    box { <X + 0.002, -0.05, Z + 0.002>, <X + L - 0.002, 0, Z + 0.128> WoodX(SF, U(SF, 0.42, 0.78)) }
    #declare X = X + L;
  #end
  #declare Z = Z + 0.13;
#end
box { <-4.2, -0.1, -3.2>, <4.2, -0.01, 3.2> Flat(Hsv(25, 0.6, 0.12)) }

// ---- ceiling: mineral tiles, light panels, a duct ----
#declare X = -4;
#while (X < 4)
  #declare Z = -3;
  #while (Z < 3)
    box { <X + 0.006, 3, Z + 0.006>, <X + 0.594, 3.02, Z + 0.594>
      texture { pigment { granite turbulence 0.4 color_map { [0 Hsv(40, 0.05, 0.55)] [0.35 Hsv(40, 0.06, 0.82)] [0.5 Hsv(40, 0.04, U(SF, 0.84, 0.92))]
        [0.75 Hsv(40, 0.05, 0.95)] [1 Hsv(40, 0.05, 0.7)] } scale U(SF, 0.2, 0.45) translate 40 * rand(SF) } finish { Matte } } }
    #declare Z = Z + 0.6;
  #end
  #declare X = X + 0.6;
#end
box { <-4.2, 3.015, -3.2>, <4.2, 3.1, 3.2> Flat(Hsv(40, 0.05, 0.6)) }
#macro Panel(X, Z) box { <X - 0.58, 2.93, Z - 0.28>, <X + 0.58, 2.995, Z + 0.28>
  texture { pigment { srgb <1, 0.98, 0.93> } finish { ambient 0 diffuse 0.6 emission (Depth ? 0 : 0.85) } } no_shadow } #end
Panel(-2.2, 0.6) Panel(1.9, 0.2)
cylinder { <-4, 2.72, 2.2>, <4, 2.72, 2.2>, 0.17
  texture { pigment { wrinkles color_map { [0 Hsv(210, 0.08, 0.45)] [0.5 Hsv(210, 0.1, 0.65)] [1 Hsv(200, 0.05, 0.85)] } scale <0.15, 0.5, 0.3> } finish { Satin } } }
#declare X = -3.6;
#while (X < 4)
  cylinder { <X, 2.72, 2.2>, <X + 0.03, 2.72, 2.2>, 0.185 Flat(Hsv(210, 0.1, U(SF, 0.3, 0.6))) }
  #declare X = X + U(SF, 0.6, 1.2);
#end
cylinder { <-4, 2.86, 1.2>, <4, 2.86, 1.2>, 0.035 Flat(Hsv(15, 0.7, 0.55)) }
cylinder { <0.3, 2.93, -3>, <0.3, 2.93, 3>, 0.025 Flat(Hsv(210, 0.1, 0.5)) }

// ---- front wall: stained plaster and a plain painted part on the right ----
box { <-4.2, -0.1, 3>, <4.2, 3.1, 3.1>
  texture { pigment { bozo turbulence 0.9 octaves 8 omega 0.7
    color_map { [0 Hsv(48, 0.28, 0.62)] [0.4 Hsv(45, 0.22, 0.82)] [0.7 Hsv(42, 0.2, 0.88)] [1 Hsv(30, 0.3, 0.7)] } scale 0.5 } finish { Matte } } }
// ---- left wall: bricks ----
box { <-4.1, -0.1, -3.2>, <-4.0, 3.1, 3.2> Flat(Hsv(35, 0.12, 0.62)) }
#declare R = 0;
#while (R < 36)
  #declare Z = -3 - U(SB, 0, 0.2);
  #while (Z < 3)
    #declare L = U(SB, 0.19, 0.26);
    box { <-4.01, R * 0.084 + 0.005, Z>, <-3.985 - U(SB, 0, 0.01), R * 0.084 + 0.074, Z + L - 0.012>
      texture { pigment { granite color_map { #local H = U(SB, 2, 26); #local V = U(SB, 0.32, 0.78); [0 Hsv(H, 0.65, V * 0.6)] [0.4 Hsv(H, 0.6, V)]
        [0.7 Hsv(H + 4, 0.5, V * 1.15)] [1 Hsv(H + 10, 0.3, V)] } scale U(SB, 0.1, 0.3) translate 50 * rand(SB) } finish { Matte } } }
    #declare Z = Z + L;
  #end
  #declare R = R + 1;
#end
// ---- right wall: paint without any texture; back wall: the same, bluish ----
box { <4, -0.1, -3.2>, <4.1, 3.1, 3.2> Flat(Hsv(95, 0.12, 0.78)) }
box { <3.97, 0, -3>, <4, 0.1, 3> Wood(SW, 0.5) }
box { <-4.2, -0.1, -3.1>, <4.2, 3.1, -3> Flat(Hsv(215, 0.18, 0.74)) }
box { <-4, 0, 2.97>, <4, 0.1, 3> WoodX(SW, 0.5) }

// ---- front wall, left to right ----
object { Bookcase(1.9, 2.1, 0.32, 6, SK) translate <-3.85, 0, 2.66> }
object { Carton(0.5, 0.3, 0.3, "MAPS 3", SC) translate <-3.4, 2.1, 2.82> }
object { Carton(0.4, 0.24, 0.28, "LENS", SC) rotate y * 14 translate <-2.75, 2.1, 2.82> }
object { Painting(0.95, 0.7, 16, SP) translate <-1.15, 2.08, 2.995> }
object { Painting(0.42, 0.55, 9, SP) translate <-0.28, 2.15, 2.995> }
object { Poster(0.6, 0.85, "ORBIT", "moons of saturn", SP) translate <0.42, 1.95, 2.99> }
object { Painting(0.7, 0.5, 14, SP) translate <-1.1, 1.28, 2.995> }
object { Poster(0.42, 0.6, "FERNS", "a field guide", SP) translate <-0.35, 1.25, 2.99> }
union { // whiteboard
  box { <-0.7, -0.45, -0.02>, <0.7, 0.45, 0> Flat(Hsv(200, 0.03, 0.93)) }
  Frame(1.4, 0.9, 0.025, SW)
  object { Word("Plan for week 12", 0.12, Hsv(220, 0.9, 0.5)) translate <-0.62, 0.28, -0.021> }
  object { Word("1 sort the lenses", 0.09, Hsv(0, 0, 0.1)) translate <-0.6, 0.12, -0.021> }
  object { Word("2 oil the lathe", 0.09, Hsv(0, 0, 0.1)) translate <-0.6, -0.01, -0.021> }
  object { Word("3 call Rhea: 3.7 mm?", 0.09, Hsv(5, 0.85, 0.6)) translate <-0.6, -0.14, -0.021> }
  object { Word("y = a sin(kx) + b", 0.08, Hsv(130, 0.8, 0.35)) translate <-0.6, -0.33, -0.021> }
  #local A = 0;
  #while (A < 40)
    sphere { <0.27 + A * 0.009, 0.12 * sin(A * 0.31) * exp(-A * 0.02), -0.021>, 0.007 Flat(Hsv(280, 0.8, 0.5)) }
    #local A = A + 1;
  #end
  translate <1.75, 1.55, 2.99>
}
union { // door
  box { <-0.45, 0, -0.04>, <0.45, 2.05, 0> WoodY(SW, 0.6) }
  box { <-0.36, 0.2, -0.05>, <-0.05, 0.85, 0> WoodY(SW, 0.45) }
  box { <0.05, 0.2, -0.05>, <0.36, 0.85, 0> WoodY(SW, 0.5) }
  box { <-0.36, 1.0, -0.05>, <0.36, 1.9, 0> WoodX(SW, 0.5) }
  object { Poster(0.3, 0.42, "EXIT", "keep it shut", SP) translate <0, 1.45, -0.051> }
  sphere { <0.38, 1.0, -0.09>, 0.035 texture { pigment { Hsv(45, 0.6, 0.8) } finish { Satin } } }
  translate <3.2, 0, 2.99>
}

// ---- left wall: window with a landscape, pegboard with tools, pictures ----
union {
  box { <-0.6, -0.5, 0>, <0.6, 0.5, 0.01>
    texture { pigment { gradient y turbulence <0.4, 0.25, 0> octaves 6
      color_map { [0 Hsv(100, 0.6, 0.25)] [0.2 Hsv(90, 0.65, 0.5)] [0.3 Hsv(120, 0.5, 0.35)] [0.45 Hsv(140, 0.35, 0.5)] [0.5 Hsv(210, 0.3, 0.85)]
        [0.7 Hsv(215, 0.45, 0.9)] [0.8 Hsv(210, 0.05, 1)] [1 Hsv(220, 0.5, 0.85)] } translate -0.5 * y scale 1.02 }
      finish { ambient 0 diffuse 0.7 emission (Depth ? 0 : 0.35) } } }
  Frame(1.2, 1.0, 0.06, SW)
  box { <-0.02, -0.5, -0.02>, <0.02, 0.5, 0> WoodY(SW, 0.7) }
  box { <-0.6, 0.08, -0.02>, <0.6, 0.11, 0> WoodX(SW, 0.7) }
  #local I = 0;
  #while (I < 26)
    #local SX = (I < 13 ? -0.95 + 0.03 * I : 0.57 + 0.03 * (I - 13));
    cylinder { <SX, -0.75, -0.05>, <SX, 0.7, -0.05>, U(SW, 0.016, 0.028) RandomTexture(SW, 0.06) }
    #local I = I + 1;
  #end
  cylinder { <-1.05, 0.72, -0.06>, <1.05, 0.72, -0.06>, 0.015 WoodX(SW, 0.3) }
  rotate -y * 90 translate <-3.97, 1.65, 1.75>
}
union { // pegboard
  box { <-0.85, -0.5, -0.015>, <0.85, 0.5, 0> WoodX(SW, 0.75) }
  #local I = 0;
  #while (I < 16)
    object { Tool(SC) translate <-0.74 + 0.213 * mod(I, 8), 0.36 - 0.46 * int(I / 8) + U(SC, -0.05, 0.05), -0.015> }
    #local I = I + 1;
  #end
  rotate -y * 90 translate <-3.97, 1.55, -0.35>
}
union { // workbench with things on it, along the left wall
  box { <-1.0, 0.84, -0.6>, <1.0, 0.9, 0> WoodX(SW, 0.68) }
  box { <-0.97, 0, -0.55>, <-0.88, 0.84, -0.05> WoodY(SW, 0.5) }
  box { <0.88, 0, -0.55>, <0.97, 0.84, -0.05> WoodY(SW, 0.5) }
  box { <-0.88, 0.2, -0.55>, <0.88, 0.23, -0.05> WoodX(SW, 0.5) }
  object { Carton(0.42, 0.3, 0.3, "BOLTS", SC) translate <-0.55, 0.23, -0.3> }
  object { Carton(0.36, 0.4, 0.3, "WIRE", SC) translate <0.0, 0.23, -0.3> }
  object { Crate(0.42, SC) translate <0.55, 0.23, -0.3> }
  #local I = 0;
  #while (I < 7)
    cylinder { <-0.8 + 0.2 * I, 0.9, -0.2 - U(SC, 0, 0.25)>, <-0.8 + 0.2 * I, 0.9 + U(SC, 0.1, 0.26), -0.2 - U(SC, 0, 0.02)>, U(SC, 0.04, 0.075)
      RandomTexture(SC, 0.04) }
    #local I = I + 1;
  #end
  object { Carton(0.24, 0.16, 0.2, "M8", SC) rotate y * 30 translate <0.75, 0.9, -0.35> }
  rotate -y * 90 translate <-3.97, 0, -0.35>
}

// ---- right wall: cupboard, two pictures, then nothing ----
union {
  box { <-0.6, 0.08, -0.45>, <0.6, 1.25, 0> WoodY(SW, 0.55) }
  #local I = 0;
  #while (I < 8)
    #local DX = -0.58 + 0.59 * mod(I, 2);
    #local DY = 0.1 + 0.285 * int(I / 2);
    box { <DX, DY, -0.47>, <DX + 0.57, DY + 0.27, -0.45> WoodX(SW, U(SW, 0.5, 0.8)) }
    sphere { <DX + 0.285, DY + 0.13, -0.48>, 0.022 Flat(Hsv(40, 0.5, 0.3)) }
    box { <DX + 0.15, DY + 0.19, -0.472>, <DX + 0.42, DY + 0.25, -0.45> Flat(Hsv(50, 0.1, 0.9)) }
    object { Centred(concat("A", str(I * 7 + 12, 0, 0)), 0.06, Hsv(0, 0, 0.1)) translate <DX + 0.285, DY + 0.2, -0.472> }
    #local I = I + 1;
  #end
  sphere { <-0.32, 1.47, -0.24>, 0.2 texture { pigment { bozo turbulence 0.6 octaves 7 omega 0.6
    color_map { [0 Hsv(215, 0.7, 0.5)] [0.5 Hsv(205, 0.6, 0.7)] [0.51 Hsv(90, 0.5, 0.5)] [0.7 Hsv(45, 0.5, 0.7)] [1 Hsv(30, 0.5, 0.4)] } scale 0.13 }
    finish { Satin } } }
  object { Plant(0.5, 40, SC) scale 0.75 translate <0.3, 1.25, -0.24> }
  rotate y * 90 translate <3.97, 0, 0.95>
}
object { Painting(0.9, 0.65, 18, SP) rotate y * 90 translate <3.99, 2.1, 0.95> }
object { Poster(0.55, 0.8, "TIDES", "harbour 1931", SP) rotate y * 90 translate <3.99, 1.75, 2.15> }
object { Painting(0.5, 0.5, 10, SP) rotate y * 90 translate <3.99, 1.75, -1.9> }

// ---- rug, table, chairs ----
union {
  box { <-1.2, 0, -0.8>, <1.2, 0.012, 0.8> texture { pigment { crackle turbulence 0.25 octaves 5
    color_map { [0 Hsv(20, 0.7, 0.2)] [0.12 Hsv(38, 0.6, 0.8)] [0.2 Hsv(2, 0.75, 0.5)] [0.5 Hsv(350, 0.65, 0.4)] [1 Hsv(215, 0.6, 0.3)] } scale 0.22 } finish { Matte } } }
  #local I = 0;
  #while (I < 46)
    #local P = <U(SC, -1.05, 1.05), 0, U(SC, -0.65, 0.65)>;
    cylinder { P, P + y * (0.0125 + 0.0001 * I), U(SC, 0.03, 0.12) RandomTexture(SC, 0.06) }
    #local I = I + 1;
  #end
  rotate y * 12 translate <0.6, 0, 0.55>
}
union { // table
  #local I = 0;
  #while (I < 5)
    box { <-0.8, 0.7, -0.4 + 0.16 * I + 0.002>, <0.8, 0.74, -0.24 + 0.16 * I - 0.002> WoodX(SW, U(SW, 0.55, 0.8)) }
    #local I = I + 1;
  #end
  cylinder { <-0.72, 0, -0.34>, <-0.72, 0.7, -0.34>, 0.035 WoodY(SW, 0.5) }
  cylinder { <0.72, 0, -0.34>, <0.72, 0.7, -0.34>, 0.035 WoodY(SW, 0.5) }
  cylinder { <-0.72, 0, 0.34>, <-0.72, 0.7, 0.34>, 0.035 WoodY(SW, 0.5) }
  cylinder { <0.72, 0, 0.34>, <0.72, 0.7, 0.34>, 0.035 WoodY(SW, 0.5) }
  object { Monitor(SC) rotate y * 8 translate <0.25, 0.74, 0.12> }
  box { <0.0, 0.74, -0.3>, <0.44, 0.76, -0.15> Flat(Hsv(0, 0, 0.15)) }
  #local I = 0;
  #while (I < 48)
    box { <0.01 + 0.035 * mod(I, 12), 0.76, -0.29 + 0.034 * int(I / 12)>, <0.037 + 0.035 * mod(I, 12), 0.768, -0.263 + 0.034 * int(I / 12)>
      Flat(Hsv(40, 0.1, U(SC, 0.3, 0.95))) }
    #local I = I + 1;
  #end
  difference { cylinder { 0, y * 0.1, 0.042 } cylinder { y * 0.01, y * 0.11, 0.037 } translate <-0.2, 0.74, -0.22> RandomTexture(SC, 0.03) }
  sphere { <-0.52, 0.86, 0.05>, 0.12 RandomTexture(SC, 0.06) }
  cone { <-0.52, 0.93, 0.05>, 0.05, <-0.52, 1.1, 0.05>, 0.075 RandomTexture(SC, 0.06) }
  #local I = 0;
  #while (I < 6)
    object { Book(0.03 + 0.02 * rand(SC), 0.24, 0.17, SC) rotate z * 90 rotate y * U(SC, -20, 20) translate <0.72, 0.745 + 0.051 * I, -0.2> }
    #local I = I + 1;
  #end
  rotate y * 12 translate <0.75, 0, 0.75>
}
object { Chair(SC) rotate y * 200 translate <0.35, 0.012, -0.05> }
object { Chair(SC) rotate y * 160 translate <1.25, 0.012, 0.1> }
object { Chair(SC) rotate y * 95 translate <2.6, 0, -0.9> }

// ---- things on the floor ----
object { Barrel(0.3, 0.85, SC) translate <-1.6, 0, 1.9> }
object { Barrel(0.24, 0.7, SC) translate <-1.0, 0, 2.3> }
object { Crate(0.55, SC) rotate y * 25 translate <-2.2, 0, 0.75> }
object { Crate(0.4, SC) rotate -y * 10 translate <-2.25, 0.55, 0.78> }
object { Carton(0.5, 0.4, 0.4, "ATLAS", SC) rotate -y * 20 translate <-1.25, 0, 0.45> }
object { Carton(0.38, 0.3, 0.3, "PRISM", SC) rotate y * 12 translate <-1.28, 0.4, 0.47> }
object { Carton(0.45, 0.35, 0.4, "CAMS", SC) rotate -y * 42 translate <2.35, 0, 2.2> }
object { Carton(0.4, 0.3, 0.35, "TUBES", SC) rotate -y * 35 translate <2.32, 0.35, 2.2> }
object { Plant(1.25, 60, SC) translate <3.45, 0, 2.25> }
object { Plant(0.85, 50, SC) translate <-3.3, 0, 1.4> }
object { Plant(0.7, 46, SC) translate <-0.15, 0, 2.55> }
union { // an armchair
  superellipsoid { <0.3, 0.3> scale <0.4, 0.2, 0.4> translate y * 0.25 RandomTexture(SC, 0.08) }
  superellipsoid { <0.3, 0.3> scale <0.4, 0.35, 0.12> translate <0, 0.6, 0.38> RandomTexture(SC, 0.08) }
  superellipsoid { <0.3, 0.4> scale <0.1, 0.3, 0.42> translate <-0.45, 0.35, 0> RandomTexture(SC, 0.05) }
  superellipsoid { <0.3, 0.4> scale <0.1, 0.3, 0.42> translate <0.45, 0.35, 0> RandomTexture(SC, 0.05) }
  superellipsoid { <0.6, 0.6> scale <0.2, 0.2, 0.07> rotate x * 20 translate <0.05, 0.62, 0.2> RandomTexture(SC, 0.04) }
  rotate y * 55 translate <2.75, 0, 0.55>
}
union { // a ladder against the front wall
  cylinder { <-0.22, 0, 0>, <-0.17, 2.5, 0>, 0.025 WoodY(SW, 0.75) }
  cylinder { <0.22, 0, 0>, <0.17, 2.5, 0>, 0.025 WoodY(SW, 0.75) }
  #local I = 0;
  #while (I < 8)
    cylinder { <-0.2, 0.25 + 0.29 * I, 0>, <0.2, 0.25 + 0.29 * I, 0>, 0.018 WoodX(SW, 0.7) }
    #local I = I + 1;
  #end
  rotate x * 14 translate <1.0, 0, 2.3>
}
union { // a standing lamp, left and near
  cylinder { 0, y * 0.03, 0.16 Flat(Hsv(30, 0.4, 0.25)) }
  cylinder { 0, y * 1.35, 0.014 Flat(Hsv(40, 0.5, 0.5)) }
  cone { y * 1.3, 0.22, y * 1.6, 0.13 open RandomTexture(SC, 0.1) }
  translate <-2.9, 0, -1.2>
}
union { // a stool with a toolbox, right and near
  cylinder { y * 0.5, y * 0.54, 0.19 RandomTexture(SC, 0.08) }
  cone { <0.14, 0, 0>, 0.02, <0.08, 0.5, 0>, 0.02 WoodY(SW, 0.6) }
  cone { <-0.08, 0, 0.12>, 0.02, <-0.05, 0.5, 0.07>, 0.02 WoodY(SW, 0.6) }
  cone { <-0.08, 0, -0.12>, 0.02, <-0.05, 0.5, -0.07>, 0.02 WoodY(SW, 0.6) }
  object { Carton(0.3, 0.2, 0.18, "KIT 5", SC) rotate y * 25 translate y * 0.54 }
  translate <1.75, 0, -0.65>
}
sphere { <0.05, 0.16, -0.35>, 0.16 RandomTexture(SC, 0.1) }
sphere { <-0.6, 0.11, 1.1>, 0.11 RandomTexture(SC, 0.06) }

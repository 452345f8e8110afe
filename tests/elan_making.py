"""The part of ELAN's schema that our annotation files use.

Written after the published description of EAF 3.0: elements and attributes in the order and of the
kinds that it lists; what we never write is left out, so that it would be refused.
"""

EAF_SCHEMA = """<?xml version="1.0" encoding="UTF-8"?>
<xs:schema xmlns:xs="http://www.w3.org/2001/XMLSchema" elementFormDefault="qualified">
  <xs:element name="ANNOTATION_DOCUMENT">
    <xs:complexType>
      <xs:sequence>
        <xs:element name="HEADER" type="head"/>
        <xs:element name="TIME_ORDER">
          <xs:complexType><xs:sequence>
            <xs:element name="TIME_SLOT" minOccurs="0" maxOccurs="unbounded">
              <xs:complexType>
                <xs:attribute name="TIME_SLOT_ID" type="xs:ID" use="required"/>
                <xs:attribute name="TIME_VALUE" type="xs:unsignedInt"/>
              </xs:complexType>
            </xs:element>
          </xs:sequence></xs:complexType>
        </xs:element>
        <xs:element name="TIER" type="tier" minOccurs="0" maxOccurs="unbounded"/>
        <xs:element name="LINGUISTIC_TYPE" minOccurs="0" maxOccurs="unbounded">
          <xs:complexType>
            <xs:attribute name="LINGUISTIC_TYPE_ID" type="xs:string" use="required"/>
            <xs:attribute name="TIME_ALIGNABLE" type="xs:boolean"/>
            <xs:attribute name="CONSTRAINTS" type="xs:string"/>
            <xs:attribute name="GRAPHIC_REFERENCES" type="xs:boolean"/>
          </xs:complexType>
        </xs:element>
      </xs:sequence>
      <xs:attribute name="DATE" type="xs:dateTime" use="required"/>
      <xs:attribute name="AUTHOR" type="xs:string" use="required"/>
      <xs:attribute name="VERSION" type="xs:string" use="required"/>
      <xs:attribute name="FORMAT" type="xs:string" default="3.0"/>
    </xs:complexType>
    <xs:key name="types">
      <xs:selector xpath="LINGUISTIC_TYPE"/><xs:field xpath="@LINGUISTIC_TYPE_ID"/>
    </xs:key>
    <xs:keyref name="tierType" refer="types">
      <xs:selector xpath="TIER"/><xs:field xpath="@LINGUISTIC_TYPE_REF"/>
    </xs:keyref>
    <xs:key name="tiers"><xs:selector xpath="TIER"/><xs:field xpath="@TIER_ID"/></xs:key>
  </xs:element>
  <xs:complexType name="head">
    <xs:sequence>
      <xs:element name="MEDIA_DESCRIPTOR" minOccurs="0" maxOccurs="unbounded">
        <xs:complexType>
          <xs:attribute name="MEDIA_URL" type="xs:anyURI" use="required"/>
          <xs:attribute name="RELATIVE_MEDIA_URL" type="xs:anyURI"/>
          <xs:attribute name="MIME_TYPE" type="xs:string" use="required"/>
          <xs:attribute name="TIME_ORIGIN" type="xs:long"/>
          <xs:attribute name="EXTRACTED_FROM" type="xs:anyURI"/>
        </xs:complexType>
      </xs:element>
      <xs:element name="PROPERTY" minOccurs="0" maxOccurs="unbounded">
        <xs:complexType><xs:simpleContent><xs:extension base="xs:string">
          <xs:attribute name="NAME" type="xs:string"/>
        </xs:extension></xs:simpleContent></xs:complexType>
      </xs:element>
    </xs:sequence>
    <xs:attribute name="MEDIA_FILE" type="xs:string" use="required"/>
    <xs:attribute name="TIME_UNITS" default="milliseconds">
      <xs:simpleType><xs:restriction base="xs:string">
        <xs:enumeration value="NTSC-frames"/><xs:enumeration value="PAL-frames"/>
        <xs:enumeration value="milliseconds"/>
      </xs:restriction></xs:simpleType>
    </xs:attribute>
  </xs:complexType>
  <xs:complexType name="tier">
    <xs:sequence>
      <xs:element name="ANNOTATION" minOccurs="0" maxOccurs="unbounded">
        <xs:complexType><xs:sequence>
          <xs:element name="ALIGNABLE_ANNOTATION">
            <xs:complexType>
              <xs:sequence><xs:element name="ANNOTATION_VALUE" type="xs:string"/></xs:sequence>
              <xs:attribute name="ANNOTATION_ID" type="xs:ID" use="required"/>
              <xs:attribute name="TIME_SLOT_REF1" type="xs:IDREF" use="required"/>
              <xs:attribute name="TIME_SLOT_REF2" type="xs:IDREF" use="required"/>
            </xs:complexType>
          </xs:element>
        </xs:sequence></xs:complexType>
      </xs:element>
    </xs:sequence>
    <xs:attribute name="TIER_ID" type="xs:string" use="required"/>
    <xs:attribute name="PARTICIPANT" type="xs:string"/>
    <xs:attribute name="ANNOTATOR" type="xs:string"/>
    <xs:attribute name="LINGUISTIC_TYPE_REF" type="xs:string" use="required"/>
    <xs:attribute name="PARENT_REF" type="xs:string"/>
  </xs:complexType>
</xs:schema>
"""
